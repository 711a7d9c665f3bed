"""Beginnings of the manifolds of a saddle: those that are curves, and the lines along their eigenvectors."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from .._orbits.orbit import PeriodicOrbit
from .growth import Seed
from .reversal import StateMap, no_inverse

Kind = Literal["unstable", "stable"]
_KINDS: tuple[Kind, Kind] = ("unstable", "stable")
# Multipliers closer to the unit circle lie on it.
_ON_CIRCLE = 1e-6
# Least growth of one map of the fundamental domain.
_GROWTH = 2.0
# Distances from the saddle at which the line may end, and the error of the best of them, relative to the size of the motion.
_REACHES = 10.0 ** -np.arange(3, 10)
_STRAIGHT, _BENT = 1e-9, 1e-4


class NotSmooth(ValueError):
    """Raised where no line fits the manifold at the saddle."""


# Kind, side, multiplier, and forcing periods since the start of the orbit.
Names = tuple[Kind, int, float, int]


def kinds_of(orbit: PeriodicOrbit, which: Kind | Sequence[Kind] | None) -> list[Kind]:
    """The manifolds to follow, which must be curves."""
    given = _KINDS if which is None else (which,) if isinstance(which, str) else tuple(which)
    if not given or not set(given) <= {*_KINDS}:
        raise ValueError(f'Argument `which` must be "unstable", "stable" or both, but is {which!r}.')
    reasons = {kind: _why_not(orbit, kind) for kind in _KINDS}
    found = [kind for kind in given if not reasons[kind]]
    if not found or (which is not None and len(found) < len(given)):
        reason = next(reasons[kind] for kind in given if reasons[kind])
        possible = "".join(f' Or ask for `which="{kind}"`.' for kind in _KINDS if not reasons[kind])
        raise ValueError(reason + possible)
    return [kind for kind in _KINDS if kind in found]


def _why_not(orbit: PeriodicOrbit, kind: Kind) -> str:
    """Reason why a manifold cannot be followed; empty if it can."""
    size, is_stable = np.abs(np.asarray(orbit.multipliers)), kind == "stable"
    count = int((size < 1 - _ON_CIRCLE).sum() if is_stable else (size > 1 + _ON_CIRCLE).sum())
    if count != 1:
        number = (
            f"{count or 'None'} of the {len(size)} multipliers of the orbit {'lie' if count > 1 else 'lies'}"
        )
        manifold = f"its {kind} manifold is no curve" if count else f"it has no {kind} manifold"
        return (
            f"{number} {'inside' if is_stable else 'outside'} the unit circle, so that {manifold}: take an orbit with one such "
            "multiplier, as a saddle from `vx.edge_state` or from an unstable part of a branch."
        )
    if is_stable and (reason := no_inverse(orbit.system)):
        return f"The stroboscopic map has no inverse, which the stable manifold needs: {reason}."
    if is_stable and size.min() < np.finfo(float).eps:
        return "A mass sticks in the orbit, where the stroboscopic map has no inverse, which the stable manifold needs."
    return ""


def seeds_of(orbit: PeriodicOrbit, kind: Kind, size: float, all_points: bool) -> list[tuple[Names, Seed]]:
    """The lines from which one manifold grows, on both sides of every point of the orbit."""
    forward, found = StateMap.of_orbit(orbit, 1), []
    backward = StateMap.of_orbit(orbit, -1) if kind == "stable" else None
    state = np.concatenate([orbit.x0, orbit.v0]) * forward.scale
    for period in range(orbit.num_periods if all_points else 1):
        multiplier, direction = _eigenvector(orbit, forward, state, kind)
        growth = np.log(abs(multiplier)) * (1 if kind == "unstable" else -1)
        repeats = int(np.ceil(np.log(_GROWTH) / growth))
        repeats += repeats % 2 if multiplier < 0 else 0
        for side in (1, -1):
            seed = Seed(
                saddle=state,
                direction=side * direction,
                multiplier=float(np.exp(growth * repeats)),
                reach=size,
                map=forward if backward is None else backward,
                inverse=None if backward is None else forward,
                num_periods=orbit.num_periods * repeats,
                size=size,
            )
            found.append(((kind, side, multiplier, period), _with_reach(seed)))
        if all_points:
            state = forward(state[None], 1)[0]
    return found


def _eigenvector(
    orbit: PeriodicOrbit, forward: StateMap, state: np.ndarray, kind: Kind
) -> tuple[float, np.ndarray]:
    """The multiplier outside the unit circle, or inside, and its unit vector (W x, v), at a point of the orbit."""
    values, vectors = np.linalg.eig(forward.derivative(state, orbit.num_periods))
    size = np.abs(values)
    k = int(size.argmax() if kind == "unstable" else size.argmin())
    direction = np.real(vectors[:, k]) / np.linalg.norm(np.real(vectors[:, k]))
    first = direction[np.abs(direction) > 1e-9][0]
    return float(np.real(values[k])), direction * np.sign(first)


def _with_reach(seed: Seed) -> Seed:
    """A line that ends as far from the saddle as the curve is straight."""
    lines = [replace(seed, reach=float(seed.size * reach)) for reach in _REACHES]
    ends = np.array([0.0, 1.0])
    states = np.stack([line.line(ends) for line in lines])
    off = np.linalg.norm(seed.after(states[:, 0]) - states[:, 1], axis=1) / seed.size
    off = np.where(np.isfinite(off), off, np.inf)
    straight = np.flatnonzero(off < _STRAIGHT)
    best = int(straight[0] if straight.size else off.argmin())
    if not off[best] < _BENT:
        raise NotSmooth(
            "The map is not smooth near the orbit: it nearly grazes a stop, sticks, or meets one just at its start. Take an orbit "
            "beside, at another parameter, or another `phase` of `vx.periodic_orbit`."
        )
    return lines[best]
