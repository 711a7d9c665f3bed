"""Grazing as vertical lines: where the steady motion without impacts just reaches a stop."""

import itertools
from collections.abc import Callable, Iterable

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from matplotlib.axes import Axes

from .._machine.numbers import MachineNumbers, numbers_of
from .._system.description import build_from
from .._system.family_description import system_from
from .._system.force_description import NAMED_FORCE
from .._system.forcing import Harmonic
from .._system.parameters import machine_at
from .._system.system import AnySystem, machine_of
from .._system.waves import Waves
from ._axes import label_if_new
from ._colors import ink

# Values at which the motion is computed at first, and phases of it; a parabola refines the least gap.
_VALUES, _PHASES = 400, 512
# Halvings of the interval between two values, down to rounding.
_HALVINGS = 44
# A gap of this share of the largest is closed, not passed.
_ROUNDED = 1e-9


def grazing_values(system: AnySystem, path: str, low: float, high: float) -> np.ndarray:
    """Values of a parameter at which the steady motion without impacts just reaches a stop, rising.

    Args:
        system: a linear machine, or a family of such.
        path: the path of the parameter.
        low: lower end of the interval that is searched.
        high: higher end.

    Raises:
        ValueError: if the motion has no closed form, or does not exist.
    """
    if system.force is not None or system.friction or system.hysteresis:
        raise ValueError(
            "Argument `grazing` draws where the motion without impacts reaches a stop, which needs a linear machine: this one "
            "has a `force`, parametric terms, friction or hysteresis."
        )
    if system.forcing.why_not_periodic or not all(isinstance(a, Harmonic) for a in system.forcing.loads):
        raise ValueError(
            "Argument `grazing` draws where the motion without impacts reaches a stop, which is known under `vx.Harmonic` loads of "
            "one frequency alone: this machine has another load."
        )
    least_gaps = jax.vmap(_least_gaps_along(system, path))
    values = np.linspace(low, high, _VALUES)
    gaps = np.asarray(least_gaps(jnp.asarray(values)))
    if not np.isfinite(gaps).all():
        raise ValueError(
            "Argument `grazing` needs a steady motion without impacts, but no spring holds some of the masses."
        )
    k, contact = np.nonzero(np.diff(gaps > 0, axis=0))
    if not len(k):
        return np.empty(0)
    before, after, is_open = values[k], values[k + 1], gaps[k, contact] > 0
    for _ in range(_HALVINGS):
        middle = (before + after) / 2
        gap = np.asarray(least_gaps(jnp.asarray(middle)))[np.arange(len(k)), contact]
        is_before = (gap > 0) == is_open
        before, after = np.where(is_before, middle, before), np.where(is_before, after, middle)
    # In a compliant stop the motion is another one.
    found = (before + after) / 2
    gaps = np.asarray(least_gaps(jnp.asarray(found)))
    yields = np.array([stop.is_compliant for stop in machine_of(system).stops])
    is_passed = (
        yields & (np.arange(len(yields)) != contact[:, None]) & (gaps < -_ROUNDED * np.abs(gaps).max())
    )
    return np.sort(found[~is_passed.any(axis=1)])


def draw_grazing(panels: Iterable[Axes], ds: xr.Dataset, path: str) -> None:
    """Draw the values among those of a dataset at which the motion without impacts grazes, in all panels."""
    values = np.asarray(ds[path].values, float)
    style = {"color": ink("0.55", "0.55"), "linewidth": 0.8, "zorder": 0, "linestyle": (0, (6, 2))}
    is_family = "family" in ds.attrs
    system = system_from(ds.attrs) if is_family else build_from(ds.attrs, force=NAMED_FORCE)
    found = grazing_values(system, path, values.min(), values.max())
    for ax, value in itertools.product(panels, found):
        ax.axvline(value, label=label_if_new(ax, "grazing without impacts"), **style)


def _least_gaps_along(system: AnySystem, path: str) -> Callable[[Array], Array]:
    known = jax.tree.map(jnp.asarray, system)
    return jax.jit(lambda value: _least_gaps(numbers_of(machine_at(known, path, value))))


def _least_gaps(numbers: MachineNumbers) -> Array:
    """Least gap of each contact in the steady motion without impacts, (contacts,)."""
    phases = 2 * jnp.pi * jnp.arange(_PHASES) / _PHASES
    order = jnp.arange(1, len(numbers.waves.cosine) + 1)
    mass = jnp.diag(numbers.mass) if numbers.mass.ndim == 1 else jnp.asarray(numbers.mass)
    speed = (order * numbers.frequency)[:, None, None]
    dynamic = numbers.stiffness[None] - speed * speed * mass[None] + 1j * speed * numbers.damping[None]
    load = numbers.waves.cosine - 1j * numbers.waves.sine
    response = jnp.linalg.solve(dynamic, load[..., None])[..., 0]
    over_phases = lambda waves: jax.vmap(waves.at_angle, out_axes=1)(phases)  # noqa: E731
    moving = over_phases(Waves(jnp.real(response), -jnp.imag(response)))
    x = jnp.linalg.solve(numbers.stiffness, numbers.mean)[:, None] + moving
    limit = numbers.limit[:, None]
    if numbers.travel is None:
        gaps = limit - numbers.rows @ x
    else:
        moved = over_phases(numbers.travel)
        gaps = limit - (numbers.rows @ (x - moved) if numbers.signs is None else numbers.rows @ x - moved)
    return jax.vmap(_least)(gaps)


def _least(gap: Array) -> Array:
    """Least value of a periodic function, from samples, by a parabola through the lowest three."""
    k = jnp.argmin(gap)
    before, here, after = gap[k - 1], gap[k], gap[(k + 1) % len(gap)]
    curvature, slope = before + after - 2 * here, (after - before) / 2
    return here - jnp.where(curvature > 0, slope * slope / (2 * jnp.where(curvature > 0, curvature, 1)), 0)
