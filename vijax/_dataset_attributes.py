"""Attributes of a dataset: meanings, units, flags, versions.

The user chooses the units of mass, length and time, so `units` are given only where they are fixed. All attributes
are text, numbers or arrays of several numbers: NetCDF and Zarr store nothing else.
"""

import importlib.metadata
import platform
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

_MEANINGS = {
    "rotation_number": "turns round the invariant circle per cycle",
    "num_angles": "number of angles of the invariant circle",
    "mass": "mass",
    "damping": "damping",
    "stiffness": "stiffness",
    "forcing.amplitude": "amplitude of the load",
    "forcing.frequency": "angular frequency of the load",
    "forcing.phase": "phase of the load",
    "forcing.mean": "mean of the load",
    "forcing.values": "values of the load at its knots",
    "forcing.times": "times of the knots of the load",
    "forcing.phases": "phases of the knots of the load",
    "stops.position": "position of the stop",
    "stops.restitution": "coefficient of restitution",
    "stops.stiffness": "stiffness of the stop",
    "stops.damping": "damping of the stop",
    "stops.preload": "preload of the stop",
    "friction.row": "coefficients of the sliding velocity",
    "friction.force": "friction force of slip",
    "friction.static": "largest friction force of stick",
    "friction.velocity": "velocity of the surface",
    "hysteresis.row": "coefficients of the spring of the element",
    "hysteresis.stiffness": "stiffness of the element",
    "hysteresis.limit": "force at which the slider slips",
    "hysteresis.slider": "slider at the start",
    "stops.motion.amplitude": "amplitude of the motion of the stop",
    "stops.motion.phase": "phase of the motion of the stop",
    "stops.motion.mean": "mean of the motion of the stop",
    "force": "parameter of the force",
    "args": "argument of the force",
    "x0": "position at the start",
    "v0": "velocity at the start",
    "direction": "direction in which the points were visited",
    "impact_time": "time of the impact since the end of the transient",
    "impact_velocity": "velocity before the impact",
    "impact_relative_velocity": "velocity before the impact, relative to that of the stop",
    "impact_phase": "phase of the load at the impact",
    "impact_stop": "stop of the impact, -1 where there is none",
    "impact_sticks": "whether the impact completes a chatter",
    "section_x": "position at the end of the period",
    "section_v": "velocity at the end of the period",
    "section_position": "position at the end of the period",
    "section_velocity": "velocity at the end of the period",
    "max_position": "largest position in the recorded periods",
    "min_position": "smallest position in the recorded periods",
    "peak_to_peak": "largest less smallest position in the recorded periods",
    "max_velocity": "largest velocity in the recorded periods",
    "min_velocity": "smallest velocity in the recorded periods",
    "rms_position": "root of the mean square of the position over the recorded periods",
    "rms_velocity": "root of the mean square of the velocity over the recorded periods",
    "max_acceleration": "largest acceleration between impacts in the recorded periods",
    "min_acceleration": "smallest acceleration between impacts in the recorded periods",
    "rms_acceleration": "root of the mean square of the acceleration between impacts over the recorded periods",
    "max_absolute_acceleration": "largest size of the acceleration with that of the base in the recorded periods",
    "max_force": "largest contact force between impacts in the recorded periods",
    "impact_rate": "recorded impacts per unit of time",
    "impulse": "sum of the impulses of the impacts in the period",
    "dissipated_energy": "energy that the impacts in the period dissipate",
    "hysteresis_energy": "energy that the Jenkins element dissipates, a forcing period in the mean",
    "mean_velocity": "mean velocity from the end of the first recorded period to that of the last",
    "held_time": "for how long the stop holds its mass in the period",
    "forcing_period": "period of the load",
    "stop_mass": "mass of the stop",
    "num_impacts": "number of impacts in the recorded periods",
    "num_sticks": "number of sticks in the recorded periods",
    "num_friction_sticks": "number of times that friction came to rest in the recorded periods",
    "num_slider_sticks": "number of times that the slider came to rest in the recorded periods",
    "sticking": "whether friction sticks at the end",
    "sticking_time": "for how long friction sticks in the period",
    "x": "position",
    "v": "velocity",
    "steps": "number of steps",
    "stuck": "whether the stop holds its mass at the end",
    "result": "end of the run",
    "time": "time",
    "event_time": "time of the event, of a stick the end of its chatter",
    "event_stop": "stop of the event, or number of stops plus friction element, -1 where there is none",
    "event_kind": "kind of the event, -1 where there is none",
    "event_velocity_minus": "velocity before the event",
    "event_velocity_plus": "velocity after the event",
    "event_impulse": "mass times change of velocity",
    "xs": "position at the time",
    "vs": "velocity at the time",
    "event_friction_impulse": "impulse of the friction of the contact",
    "x1": "position at the end",
    "v1": "velocity at the end",
    "stuck1": "whether the stop holds its mass at the end",
    "sliders1": "sliders of the Jenkins elements at the end",
    "sticking1": "whether friction sticks at the end",
    "num_events": "number of logged events",
    "num_steps": "number of steps",
    "num_rejected": "number of steps that were not accurate enough",
    "grazing_impact_speed": "smallest speed of an impact that is no chatter",
    "grazing_clearance": "smallest gap at which a mass turned back",
    "grazing_is_near": "whether derivatives are unreliable or one-sided",
    "is_computed": "whether the point was run",
    "lyapunov_exponents": "Lyapunov exponent, per unit of time",
    "lyapunov_error": "standard error of the Lyapunov exponent",
    "multiplier_real": "real part of the Floquet multiplier",
    "multiplier_imag": "imaginary part of the Floquet multiplier",
    "multipliers": "Floquet multiplier",
    "period": "period of the orbit",
    "arclength": "length of the branch from the orbit where it was begun",
    "impact_speed": "speed of approach to the stop at the impact",
    "closest_gap": "smallest gap where the mass turns back before the stop",
    "bifurcation": "what happens to the branch at the point",
    "peak": "kind of a peak of a quantity along the branch",
    "peak_quantity": "quantity of the peak, and its mass",
    "peak_height": "quantity at the peak",
    "peak_event": "bifurcation at which the quantity has a kink at the peak",
    "flight": "duration of the flight before the event, in periods of the load",
    "held": "whether the stop holds its mass on the flight",
    "mode": "what each stop and friction element does on the flight, as a number",
    "event_guard": "1 if the event ends a mode at its second bound, else 0",
    "progression": "displacement over one cycle",
    "start": "state at the start of the cycle, as seen from the stops",
    "residual": "closing error of the orbit, relative to the size of the motion",
    "is_stable": "whether all Floquet multipliers lie inside of the unit circle",
    "is_admissible": "whether the machine follows the orbit",
    "share": "fraction of the starts that lead to the attractor",
    "share_error": "binomial standard error of the share",
    "num_starts": "number of starts that lead to the attractor",
    "num_images": "number of different images of the attractor under the symmetries of the machine",
    "motion": "kind of motion",
    "num_periods": "number of forcing periods after which the motion repeats, 0 if it does not",
    "exponents": "Lyapunov exponent",
    "exponents_error": "standard error of the Lyapunov exponent",
    "num_attractors": "number of attractors",
    "num_not_settled": "number of starts whose motion has not settled",
    "num_failed": "number of starts whose motion failed",
    "label": "number of the attractor, -1 where it is not known",
    "is_failed": "whether the motion failed",
    "is_found": "whether the attractor is found there",
    "birth": "first value at which the attractor is found, NaN if that is the first of all",
    "death": "first value at which the attractor is found no more, NaN if it is found at the last",
    "successor": "attractor that the motion reaches where its own ends, -1 if unknown",
    "converged": "whether an orbit was found that the machine follows",
    "t0": "start time",
    "t1": "end time",
}
# Dimensions that no variable is named after.
_DIMENSIONS = (
    *(
        "stop",
        "impact",
        "exponent",
        "friction",
        "hysteresis",
        "row",
        "harmonic",
        "multiplier",
        "attractor",
        "point",
    ),
    *("event", "lane", "distance", "sample", "quantity"),
)
_UNITS = {
    "impact_phase": "rad",
    "forcing.phase": "rad",
    "forcing.phases": "rad",
    "stops.motion.phase": "rad",
    "stops.restitution": "1",
}


def variable_attributes(name: str) -> dict[str, str]:
    """Attributes of a variable or of a swept path: meaning, and unit where it is fixed."""
    name = re.sub(r"\[[^]]*\]|\.values$", "", name)
    name = re.sub(r"^(force|args)\..*", r"\1", name)
    units = {"units": _UNITS[name]} if name in _UNITS else {}
    return ({"long_name": _MEANINGS[name]} if name in _MEANINGS else {}) | units


def with_words(columns: Mapping[str, tuple[Any, Any, str]]) -> dict[str, tuple[Any, Any, dict[str, str]]]:
    """Variables of a dataset from their dimensions, values and words."""
    return {name: (dims, a, {"long_name": words}) for name, (dims, a, words) in columns.items()}


def is_taken(name: str) -> bool:
    """True for the name of a variable or a dimension of a dataset."""
    return name in _MEANINGS or name in _DIMENSIONS


# Names that are paths of machines alone.
_PATHS = ("damping", "stiffness", "force", "args", "x0", "v0")


def check_column(path: str) -> None:
    """Refuse a path that cannot name a column of a dataset.

    Raises:
        ValueError: if it names another variable or a dimension.
    """
    if is_taken(path) and "." not in path and path not in _PATHS:
        raise ValueError(
            f"The path `{path}` names a variable or a dimension of the dataset: give the value of the family another name."
        )


def flags(names: Sequence[str]) -> dict[str, str | np.ndarray]:
    """Attributes that name the codes 0, 1, 2, ... of a variable."""
    return {"flag_values": np.arange(len(names), dtype=np.int8), "flag_meanings": " ".join(names)}


@cache
def versions() -> dict[str, str]:
    """Versions of vijax, of the packages that compute, and of Python."""
    found = {f"{name}_version": version(name) for name in ("vijax", "jax", "numpy")}
    return found | {"python_version": platform.python_version()}


def version(name: str) -> str:
    """Version of an installed package."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "0+not.installed"  # a checkout on the path; a version that tools can parse
