"""Wave forms, records, parametric stiffness and nonlinear forces of random machines."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import vijax as vx

from .shapes import Shape

# Knots of a wave form or a record, and the forcing periods that a record takes.
KNOTS, LENGTH = 5, 8.0
# Share of the shapes that have each of them, and of the machines to which each coincidence happens.
SHARE, COINCIDENCES = 0.4, 0.25


class Hardening(eqx.Module):
    """Cubic springs to the ground."""

    stiffness: Array

    def __call__(self, t: Any, x: Array, v: Array, args: object) -> Array:
        """Force on the masses."""
        return -self.stiffness * x**3


class Walls(eqx.Module):
    """Linear walls without dampers, each before one mass."""

    rows: Array
    places: Array
    stiffness: Array

    def __call__(self, t: Any, x: Array, v: Array, args: object) -> Array:
        """Force on the masses."""
        return -self.rows.T @ (self.stiffness * jnp.maximum(self.rows @ x - self.places, 0.0))


def with_extras(rng: np.random.Generator, shape: Shape, a: dict) -> tuple[Shape, dict]:
    """The shape with another load and other forces, and their numbers, (count, ...) each."""
    count, n = a["v0"].shape
    load = str(rng.choice(["harmonic", "wave", "table"])) if shape.is_driven else "harmonic"
    may = not shape.sliders  # which stand beside linear forces only
    shape = shape._replace(
        load=load,
        kind=str(rng.choice(["linear", "previous", "cubic"])),
        is_parametric=bool(may and rng.random() < SHARE and shape.is_driven),
        is_nonlinear=bool(may and rng.random() < SHARE),
    )
    gaps = rng.uniform(0.2, 1.0, (count, KNOTS + 1))
    places = np.cumsum(gaps, axis=1)[:, :-1] / gaps.sum(axis=1, keepdims=True)
    numbers = {
        "knots": places,
        "values": rng.normal(size=(count, KNOTS, n)),
        "swing": rng.uniform(0.05, 0.4, (count, 1, 1)) * a["stiffness"],
        "swing_phase": rng.uniform(0, 2 * np.pi, (count, 1)),
        "cubic": 10 ** rng.uniform(-1.5, 1.0, (count, n)),
    }
    if load == "table":
        numbers["knots"] = places * LENGTH * 2 * np.pi / a["frequency"][:, None]
    return shape, a | numbers


def degenerate_extras(rng: np.random.Generator, shape: Shape, a: dict) -> dict:
    """Let coincidences happen: knots at quarters of a period, values 0 and 1, the same for all masses, no cubic spring."""
    count = len(a["v0"])
    a = {name: np.array(value) for name, value in a.items()}

    def some() -> np.ndarray:
        return np.flatnonzero(rng.random(count) < COINCIDENCES)

    own = some()
    quarters = np.arange(KNOTS) / 4 if shape.load == "table" else np.arange(KNOTS) / 8
    unit = 2 * np.pi / a["frequency"] if shape.load == "table" else np.ones(count)
    a["knots"][own] = quarters * unit[own, None]
    own = some()
    a["values"][own] = np.round(a["values"][own])
    own = some()
    a["values"][own] = a["values"][own][:, :, :1]
    for name in ("cubic", "swing", "swing_phase"):
        a[name][some()] = 0.0
    a["cubic"][some()] = 1.0
    return a


def load_of(shape: Shape, a: dict, harmonic: vx.Harmonic) -> Any:
    """The load of one machine: its harmonics, a wave form in their place, or a record beside them."""
    if shape.load == "wave":
        return vx.Waveform(2 * np.pi * a["knots"], a["values"], a["frequency"], shape.kind)
    return harmonic + vx.Tabulated(a["knots"], a["values"], shape.kind) if shape.load == "table" else harmonic


def forces_of(shape: Shape, a: dict) -> dict[str, Any]:
    """Arguments of a machine for its nonlinear and parametric forces."""
    given: dict[str, Any] = {}
    if shape.is_nonlinear:
        given["force"] = Hardening(jnp.asarray(a["cubic"]))
    if shape.walls:
        rows = [(1.0 if side == "upper" else -1.0) * np.eye(shape.masses)[i] for i, side in shape.walls]
        given["force"] = Walls(*map(jnp.asarray, (rows, a["wall"], a["wall_stiffness"])))
    if shape.is_parametric:
        given["parametric"] = vx.Parametric(
            a["swing"][None], frequency=a["frequency"], phase=a["swing_phase"]
        )
    return given
