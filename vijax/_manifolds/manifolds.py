"""Stable and unstable manifolds of saddles of the stroboscopic map."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from jaxtyping import ArrayLike

from .._dataset_attributes import versions, with_words
from .._jax.arrays import Count, real_number, refuse_single_precision, whole_number
from .._jax.concrete import concrete
from .._jax.xla import padding_allowed
from .._orbits.orbit import PeriodicOrbit
from .._progress import interrupt_with_result, says_what_compiles, tqdm
from .curve_points import is_known
from .growth import CurveGrowth
from .reversal import StateMap
from .seeds import Kind, Names, kinds_of, seeds_of

# Default length and spacing, relative to the size of the motion.
_LENGTH, _SPACING = 20.0, 0.01


@says_what_compiles
@padding_allowed
def manifolds(
    orbit: PeriodicOrbit,
    *,
    which: Kind | Sequence[Kind] | None = None,
    length: ArrayLike | None = None,
    spacing: ArrayLike | None = None,
    bounds: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
    all_points: bool = False,
    max_points: Count = 10_000,
    progress: bool = True,
) -> xr.Dataset:
    """Follow the stable and the unstable manifold of a saddle of the stroboscopic map, both sides of each.

    The unstable manifold consists of the states that come from the saddle, the stable one of those that go to it. On it lies
    the boundary between basins, if the saddle does. A curve is followed if one multiplier lies outside the unit
    circle, or one inside. The stable one is followed by the machine backwards in time, and every state is checked forwards.

    The map contracts onto the curve, so that errors die out along it. Neighbours are closer than `spacing` and turn by less than
    0.2 rad, except at corners, which grazing impacts make. Curves are cut where they jump: at a stop, where the velocity is
    reversed; where the machine must stick, before which the past is not known; at the bounds.

    Args:
        orbit: the saddle, result of `vx.periodic_orbit`, or `.orbit` of a point of a branch.
        which: "unstable", "stable", or both; those that are curves if left out.
        length: length of each side at most, in the norm of (W x, v); if left out, 20 times the size of the saddle: the largest of
            W x and v at its start and of its impact velocities.
        spacing: largest distance of neighbours, likewise; if left out, 0.01 times that size.
        bounds: lowest and highest values of start quantities, as {"x0[0]": (-1, 1)}, beyond which the curve is not drawn.
            It may come back; what is beyond does not count in `length`.
        all_points: for an orbit of n periods, the curves at each of its n points at its phase; at its start alone if left out.
        max_points: points of each side at most.
        progress: show a progress bar.

    Returns:
        `x0`, `v0` (branch, point, mass), states at the phase of the orbit in the order of the curve, from the saddle on, NaN
        where it is cut and behind its end; `arclength` (branch, point), in (W x, v); `piece` (branch, point), counted from 0, -1
        between them. Along `branch`: `kind`; `side`, 1 where x0[0] (or the next state that changes) grows at
        first, else -1; `multiplier`; `period`, the number of forcing periods since the start of the orbit; `end`, why the
        curve ends: "length", "points", "attractor" (the rest is shorter than a twentieth of the spacing), "lost"
        (no states before, or after), "bounds", "interrupted".

    Raises:
        ValueError: if no curve exists or can be followed, with the remedy; for a cycle without load, an orbit that the
            machine does not follow or that grazes; for arguments that do not fit; in single precision.
        Interrupted: after Ctrl-C, a `KeyboardInterrupt` whose `result` is the part followed so far.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.two_sided_oscillator(3.0, damping_ratio=0.025)
        saddle = vx.periodic_orbit(system, [-0.496], [-0.472], 2)
        curves = vx.manifolds(saddle, which="unstable", length=20.0)
        ```

    References:
        D. Hobson, J. Comput. Phys. 104 (1993) 14; Z. You, E. J. Kostelich & J. A. Yorke, Int. J. Bifurcation Chaos 1 (1991)
        605; B. Krauskopf & H. M. Osinga, J. Comput. Phys. 146 (1998) 404.
    """
    check_saddle(orbit)
    kinds = kinds_of(orbit, which)
    size = size_of(orbit)
    longest, near = (
        _positive("length", length, _LENGTH * size),
        _positive("spacing", spacing, _SPACING * size),
    )
    most, box = whole_number("max_points", max_points, 2), _box(orbit, bounds)
    seeds = [one for kind in kinds for one in seeds_of(orbit, kind, size, all_points)]
    curves: list[tuple[Names, CurveGrowth]] = []

    def result_so_far() -> xr.Dataset:
        return _dataset(orbit, curves, longest, near)

    with tqdm(unit="point", disable=not progress) as bar, interrupt_with_result(result_so_far):
        for names, seed in seeds:
            curves.append((names, CurveGrowth(seed, longest, near, most, box, bar)))
            curves[-1][1].run()
    return result_so_far()


def check_saddle(orbit: PeriodicOrbit) -> None:
    """Refuse orbits at which the map has no saddle."""
    if not isinstance(orbit, PeriodicOrbit) or concrete(orbit.period) is None or np.ndim(orbit.period):
        raise ValueError("Argument `orbit` must be one orbit, as `vx.periodic_orbit` returns it.")
    refuse_single_precision("manifolds", orbit.system)
    if not orbit.num_periods:
        raise ValueError("`manifolds` is for orbits under a load: this cycle has no stroboscopic map.")
    if not bool(orbit.is_admissible):
        raise ValueError(
            "The machine does not follow this orbit, so that nothing goes to it or comes from it."
        )
    if not np.isfinite(orbit.multipliers).all():
        raise ValueError(
            "The orbit grazes a stop, and one of its multipliers is infinite: take an orbit beside, at another parameter."
        )


def size_of(orbit: PeriodicOrbit) -> float:
    """Size of an orbit, in (W x, v)."""
    speeds = np.asarray(orbit.events.velocity_minus)
    parts = [
        float(orbit.system.forcing.frequency) * np.asarray(orbit.x0),
        np.asarray(orbit.v0),
        speeds[np.isfinite(speeds)],
    ]
    return float(np.abs(np.concatenate(parts)).max())


def _positive(name: str, given: ArrayLike | None, default: float) -> float:
    value = default if given is None else real_number(name, given)
    if not (value > 0 and np.isfinite(value)):
        more = ": the saddle is at rest at 0, and has no size" if given is None else f", but is {value}"
        raise ValueError(f"Argument `{name}` must be positive{more}.")
    return value


def _box(orbit: PeriodicOrbit, bounds: Mapping[str, tuple[ArrayLike, ArrayLike]] | None) -> np.ndarray:
    """Lowest and highest states (W x, v), (2, 2 n)."""
    n = orbit.system.num_coordinates
    box = np.stack([np.full(2 * n, -np.inf), np.full(2 * n, np.inf)])
    names = [f"{one}[{i}]" for one in ("x0", "v0") for i in range(n)]
    rate = float(orbit.system.forcing.frequency)
    for name, (low, high) in (bounds or {}).items():
        if name not in names:
            raise ValueError(f"Argument `bounds` must be of {', '.join(names)}, but has {name}.")
        place, ends = names.index(name), [real_number(name, low), real_number(name, high)]
        if not ends[0] < ends[1]:
            raise ValueError(
                f"Bounds of {name} must be a lower and a higher value, but are {low} and {high}."
            )
        box[:, place] = np.array(ends) * (rate if place < n else 1.0)
    return box


def _dataset(
    orbit: PeriodicOrbit, curves: list[tuple[Names, CurveGrowth]], length: float, spacing: float
) -> xr.Dataset:
    """The curves, one after another."""
    n, scale = orbit.system.num_coordinates, StateMap.of_orbit(orbit, 1).scale
    rows = [_cut_at_jumps(np.concatenate(one.rows), spacing) for _, one in curves]
    shape = len(rows), max((len(one) for one in rows), default=0)
    states, arclength, piece = np.full((*shape, 2 * n), np.nan), np.full(shape, np.nan), np.full(shape, -1)
    for k, one in enumerate(rows):
        is_state, filled = is_known(one), slice(0, len(one))
        step = np.linalg.norm(np.diff(one, axis=0), axis=1)
        along = np.append(0.0, np.cumsum(np.nan_to_num(step, nan=0.0)))
        states[k, filled], arclength[k, filled] = one / scale, np.where(is_state, along, np.nan)
        piece[k, filled] = np.where(is_state, np.cumsum(~is_state), -1)
    names = [one for one, _ in curves]
    text = np.dtypes.StringDType()
    columns = {
        "x0": (("branch", "point", "mass"), states[..., :n], "position on the manifold"),
        "v0": (("branch", "point", "mass"), states[..., n:], "velocity on the manifold"),
        "arclength": (("branch", "point"), arclength, "length of the curve from the saddle, of (W x, v)"),
        "piece": (("branch", "point"), piece, "number of the piece of the curve, -1 between pieces"),
        "kind": ("branch", np.array([one[0] for one in names], text), "unstable or stable manifold"),
        "side": ("branch", np.array([one[1] for one in names], int), "side of the saddle"),
        "multiplier": ("branch", np.array([one[2] for one in names], float), "Floquet multiplier"),
        "period": (
            "branch",
            np.array([one[3] for one in names], int),
            "forcing periods since the start of the orbit",
        ),
        "end": ("branch", np.array([one.end for _, one in curves], text), "why the curve ends"),
    }
    attrs = {
        "num_periods": orbit.num_periods,
        "length": length,
        "spacing": spacing,
        "phase": float(orbit.phase),
    }
    return xr.Dataset(with_words(columns), attrs=attrs | versions())


def _cut_at_jumps(states: np.ndarray, spacing: float) -> np.ndarray:
    """States with one row of NaN between neighbours that are apart, as between two levels."""
    is_state = is_known(states)
    states = states[is_state | np.append(False, is_state[:-1])]
    apart = np.linalg.norm(np.diff(states, axis=0), axis=1) > 1.01 * spacing
    states = np.insert(states, np.flatnonzero(apart) + 1, np.nan, axis=0)
    return states[:-1] if len(states) and np.isnan(states[-1]).any() else states
