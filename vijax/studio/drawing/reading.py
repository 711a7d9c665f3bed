"""Schemes of machines: an `ImpactSystem`, or the machine of a trajectory."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._jax.arrays import Reals
from ..._machine.machine import Machine
from ..._machine.numbers import base_waves_of, harmonic_load_of, tones_of
from ..._machine.switching import COMPLIANT, SwitchingContacts
from ..._system.compliant import CompliantContact, CompliantStop
from ..._system.force import name_of_force, whole_force
from ..._system.forcing import Harmonic
from ..._system.hysteresis import ForceBesideSliders
from ..._system.restitution import (
    AbstractRestitution,
    Restitution,
    light_coefficient,
    restitution_of_contacts,
)
from ..._system.system import AnyStop, ImpactSystem
from ..._system.waves import Tones, Waves
from ..._trajectory.solution import Solution
from ...models._nonlinear import PendulumWeight
from ...plot._contacts import masses_of_stops
from .scheme import NOTHING, Rubbing, Scheme, formula, harmonic_terms


def scheme_of_system(system: ImpactSystem) -> Scheme:
    """Scheme of one machine; raise for a batch."""
    if system.stiffness.ndim != 2:
        raise ValueError(
            f"Machines are drawn one by one, but this is a batch of shape {system.stiffness.shape[2:]}: draw its parts."
        )
    n, (mean, whole) = system.num_masses, jax.tree.map(np.asarray, harmonic_load_of(system))
    of_base = jax.tree.map(np.asarray, base_waves_of(system))
    waves, speeds = (
        jax.tree.map(np.subtract, whole, of_base),
        _speeds(whole, system.forcing.clock, tones_of(system)),
    )
    rows = np.array([_row(n, stop.coefficients) for stop in system.stops]).reshape(-1, n)
    moving = [stop.motion is not None and bool(np.any(stop.motion.amplitude)) for stop in system.stops]
    (stiffness, damping), omitted = _drawn(
        np.asarray(system.stiffness), np.asarray(system.damping), system.num_states, len(system.hysteresis)
    )
    return Scheme(
        stiffness,
        damping,
        mean,
        waves=waves,
        frequency=float(system.forcing.clock),
        speeds=speeds,
        rows=rows,
        masses=masses_of_stops(system),
        limit=np.array([float(stop.sign * stop.centre) for stop in system.stops]),
        restitution=tuple(map(_law_in_words, system.stops)),
        is_moving=np.array(moving, bool),
        is_lumped=not system.has_full_mass,
        force=None if system.force is None else _name(system.force),
        is_compliant=np.array([stop.is_compliant for stop in system.stops], bool),
        is_damped=np.array([bool(getattr(stop, "damping", 0) > 0) for stop in system.stops], bool),
        is_preloaded=np.array([bool(getattr(stop, "preload", 0) > 0) for stop in system.stops], bool),
        friction=tuple(
            Rubbing(_row(n, one.coefficients), float(one.slip), float(one.velocity), one.contact)
            for one in system.friction
        ),
        omitted=omitted,
        accelerations=_accelerations(np.asarray(system.mass), mean),
        is_hung=isinstance(system.force, PendulumWeight),
        largest_of_tables=_largest_of_tables(system),
        base=_base_in_words(system, of_base, speeds),
    )


def _largest_of_tables(system: ImpactSystem) -> np.ndarray | None:
    tables = [load for load in system.forcing.loads if not isinstance(load, Harmonic) and not load.from_base]
    return np.sum([np.asarray(load.size()) for load in tables], axis=0) if tables else None


def _base_in_words(system: ImpactSystem, of_base: Waves, speeds: np.ndarray) -> str:
    """Acceleration of a base that moves, as a formula; empty for none."""
    mass = np.asarray(system.mass)
    cosines, sines = (-_accelerations(mass, a.T)[0] for a in (of_base.cosine, of_base.sine))
    terms = harmonic_terms(speeds, cosines, sines, NOTHING * np.max(np.abs([cosines, sines]), initial=0.0))
    has_table = any(load.from_base for load in system.forcing.loads if not isinstance(load, Harmonic))
    terms += ["+ a(t)"] if has_table else []
    return formula(terms) if terms else ""


def _accelerations(mass: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Accelerations by forces, (n, ...)."""
    return np.linalg.solve(mass, forces) if mass.ndim == 2 else (forces[: len(mass)].T / mass).T


def _row(num_masses: int, coefficients: dict[int, Any]) -> np.ndarray:
    row = np.zeros(num_masses)
    for i, a in coefficients.items():
        row[i] = float(a)
    return row


def _law_in_words(stop: AnyStop) -> str:
    if isinstance(stop, CompliantStop | CompliantContact):
        return _cushion_in_words(float(stop.stiffness), float(stop.damping), float(stop.preload))
    (words,) = _coefficients(restitution_of_contacts([stop.restitution], np.zeros(())))
    return words


def _cushion_in_words(stiffness: float, damping: float, preload: float) -> str:
    """Stiffness, and damping and preload where there are any, in a line each."""
    parts = {"k": stiffness} | {name: a for name, a in (("c", damping), ("N_0", preload)) if a > 0}
    return "\n".join(f"${name}$ = {a:.3g}" for name, a in parts.items())


def _coefficients(restitution: Restitution) -> tuple[str, ...]:
    symbol = "r(0)" if isinstance(restitution, AbstractRestitution) else "r"
    return tuple(f"${symbol}$ = {r:.3g}" for r in np.asarray(light_coefficient(restitution)))


def scheme_of_solution(sol: Solution, places: np.ndarray) -> Scheme:
    """Scheme of the machine of a trajectory; `places` are the positions of its stops, (times, stops)."""
    machine = sol.machine
    contacts, n = machine.contacts, sol.x1.shape[-1]
    inverse_mass = np.asarray(machine.inverse_mass)
    inverse, mean = inverse_mass[:n], np.asarray(machine.mean)[:n]
    inverse = inverse if inverse.ndim == 1 else inverse[:, :n]
    (stiffness, damping), omitted = _drawn(
        np.asarray(machine.stiffness)[:n, :n],
        np.asarray(machine.damping)[:n, :n],
        machine.num_states - sol.num_sliders,
        sol.num_sliders,
    )
    rows, num_stops = (
        np.asarray(contacts.rows).reshape(contacts.num, len(inverse_mass))[:, :n],
        contacts.num_stops,
    )
    words, friction = _coefficients(contacts.restitution), ()
    is_compliant = is_damped = is_preloaded = np.zeros(num_stops, bool)
    if isinstance(contacts, SwitchingContacts):
        laws, is_compliant = contacts.laws, np.array(contacts.laws.kinds[:num_stops]) == COMPLIANT
        force, velocity = (np.asarray(a) for a in (laws.force, laws.velocity))
        cushions = np.stack([laws.stiffness, laws.damping, laws.preload], axis=1)[:num_stops]
        is_damped, is_preloaded = cushions[:, 1] > 0, cushions[:, 2] > 0
        words = tuple(
            _cushion_in_words(*cushions[j].tolist()) if is_compliant[j] else words[j]
            for j in range(num_stops)
        )
        normal = laws.normal or (-1,) * contacts.num
        force = force if laws.coefficient is None else force + np.asarray(laws.coefficient)
        friction = tuple(
            Rubbing(rows[j], float(force[j]), float(velocity[j]), None if normal[j] < 0 else normal[j])
            for j in range(num_stops, contacts.num - sol.num_sliders)
        )
    tables, force = machine.tables, None if machine.extra is None else machine.extra.force
    force = force.force if isinstance(force, ForceBesideSliders) else force
    return Scheme(
        stiffness,
        damping,
        mean,
        waves=jax.tree.map(lambda a: a[:, :n], _load_in_space(machine)),
        frequency=float(machine.frequency),
        speeds=_speeds(machine.waves, machine.frequency, machine.tones),
        rows=rows[:num_stops],
        masses=contacts.masses[:num_stops],
        limit=np.asarray(contacts.limit)[:num_stops],
        restitution=words,
        is_moving=np.ptp(places, axis=0) > 0,
        is_lumped=machine.inverse_mass.ndim == 1,
        force=None if force is None else _name(force),
        is_compliant=is_compliant,
        is_damped=is_damped,
        is_preloaded=is_preloaded,
        friction=friction,
        omitted=omitted,
        accelerations=inverse @ mean if inverse.ndim == 2 else inverse * mean[: len(inverse)],
        is_hung=force is not None and isinstance(whole_force(force.force), PendulumWeight),
        largest_of_tables=None if tables is None else np.asarray(tables.bound(0)),
        of_tables=None if tables is None else lambda t: np.asarray(tables.load(tables.at(jnp.asarray(t)))),
    )


def _drawn(
    stiffness: np.ndarray, damping: np.ndarray, num_states: int, num_sliders: int
) -> tuple[list[np.ndarray], str]:
    """Symmetric parts of the matrices, without the states, and what they lack in words."""
    first = len(stiffness) - num_states
    is_mass = np.arange(len(stiffness)) < first
    between = [np.where(np.outer(is_mass, is_mass), a, 0) for a in (stiffness, damping)]
    names = [
        f"asymmetric part of the {name}"
        for name, a in zip(("stiffness", "damping"), between, strict=True)
        if np.abs(a - a.T).max() > NOTHING * np.abs(a).max()
    ]
    if num_states:
        names.append(
            "links of the last box, a state"
            if num_states == 1
            else f"links of the last {num_states} boxes, states"
        )
    if num_sliders:
        names.append("one Jenkins element" if num_sliders == 1 else f"{num_sliders} Jenkins elements")
    return [(a + a.T) / 2 for a in between], f"not drawn: {', '.join(names)}" if names else ""


def _speeds(waves: Waves, frequency: Reals, tones: Tones | None) -> np.ndarray:
    """Angular frequencies of the harmonics of a load, (harmonics,)."""
    return np.asarray(waves.speeds(frequency if tones is None else tones))[:, 0]


def _load_in_space(machine: Machine) -> Waves:
    """Harmonics of the load in space: without -M w'' - C w' - K w if the machine moves with its stops (`frame`)."""
    waves, frame = jax.tree.map(np.asarray, machine.waves), machine.frame
    if frame is not None:
        inertia = frame.load(1 / machine.inverse_mass, machine.damping, machine.stiffness)
        waves = jax.tree.map(lambda a, b: np.where(abs(a - b) > NOTHING * abs(b), a - b, 0.0), waves, inertia)
    return waves


def _name(force: object) -> str:
    """The name of a force without its parameters."""
    return name_of_force(force).partition("(")[0].strip("<>")  # pyright: ignore[reportArgumentType]
