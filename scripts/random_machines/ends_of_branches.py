"""Whether branches have the same ends backwards and in other units."""

import numpy as np
import xarray as xr

import vijax as vx

Fault = tuple[str, float]

# Branches are followed from every so many frequencies of a sweep, and from so many orbits; most impacts of these.
EVERY, MOST_STARTS, MOST_IMPACTS = 32, 128, 6
# Most points and branches of a machine.
MOST_POINTS, MOST_BRANCHES = 400, 6
# Relative error of places.
SAME = 1e-8
# Ends of branches with which nothing is wrong; the others are named by bifurcations that end a branch.
ENDS = {"bounds", "closed", "max_points", "left_the_stops", "period_doubling"}


def starts_of(orbits: xr.Dataset) -> np.ndarray:
    """Orbits at some frequencies, and where another kind of orbit begins."""
    n, impacts = orbits["num_periods"].values, orbits["num_impacts"].values
    is_other = np.append(True, (np.diff(n) != 0) | (np.diff(impacts, axis=0) != 0).any(axis=1))
    is_start = is_other | (np.arange(len(n)) % EVERY == 0)
    is_short = impacts.sum(axis=1) <= MOST_IMPACTS
    return np.flatnonzero(is_start & is_short & orbits["converged"].values)


def wrong_ends(found: list[vx.Branch]) -> list[Fault]:
    """Ends that are neither among `ENDS` nor bifurcations of the branches."""
    ends = {end for branch in found for end in branch.ends}
    kinds = {point.kind for branch in found for point in branch.bifurcations}
    return [(f"branch ends: {end}", 1.0) for end in sorted(ends - ENDS - kinds)]


def other_ends(
    orbits: tuple[xr.Dataset, xr.Dataset], found: list[vx.Branch], again: list[vx.Branch], unit: float
) -> list[Fault]:
    """Branches from other starts and in other units are the same, in any order."""
    if is_cut(found) or is_cut(again) or any(len(starts_of(its)) > MOST_STARTS for its in orbits):
        return []
    # Rounding decides to which orbit a long irregular transient leads: one of few points may be met by one sweep only.
    met = [set(its["num_periods"].values[starts_of(its)].tolist()) for its in orbits]
    rare = met[0] ^ met[1]
    rare |= {2 * n for n in rare}
    one, other = (
        [
            outline
            for outline in (_outline(branch, size) for branch in own if _is_whole(branch))
            if outline[0] not in rare
        ]
        for own, size in ((found, 1.0), (again, unit))
    )
    alone = [own for own in one if not any(_is_same(own, its) for its in other)]
    alone += [its for its in other if not any(_is_same(own, its) for own in one)]
    return [("branch: from another start it differs", float(len(alone)))] if alone else []


def _is_whole(branch: vx.Branch) -> bool:
    """False for a branch that has the first ones, from its start, of infinitely many grazings towards a completion of chatter."""
    return "chatter_completion" not in branch.ends


def is_cut(found: list[vx.Branch]) -> bool:
    """Whether the search may have ended before all branches were found."""
    points = sum(map(len, found))
    is_short = any("max_points" in branch.ends for branch in found)
    return is_short or len(found) >= MOST_BRANCHES or points >= MOST_POINTS


def _outline(branch: vx.Branch, unit: float) -> tuple[int, list[tuple[str, float]]]:
    """Number of periods, and bifurcations and ends of a branch sorted by their values, in a unit.

    Those that rounding hardly separates from a grazing are left out; a closed branch has no ends.
    """
    places = sorted((point.value / unit, point.kind) for point in branch.bifurcations)
    grazings = np.array([value for value, kind in places if kind == "gr"])
    is_apart = lambda value: (np.abs(grazings - value) > SAME * abs(value)).all()  # noqa: E731
    points = [(value, kind) for value, kind in places if kind == "gr" or is_apart(value)]
    ends = sorted(
        (branch.values[k] / unit, end) for k, end in zip((0, -1), branch.ends, strict=True) if end != "closed"
    )
    return int(branch.points.attrs["num_periods"]), [(kind, value) for value, kind in points + ends]


def _is_same(one: tuple, other: tuple) -> bool:
    (n, own), (m, its) = one, other
    return (
        n == m
        and len(own) == len(its)
        and all(a[0] == b[0] and abs(a[1] - b[1]) <= SAME * abs(a[1]) for a, b in zip(own, its, strict=True))
    )
