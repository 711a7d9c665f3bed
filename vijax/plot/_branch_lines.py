"""The lines of a branch in a picture: of its impacts at a stop, or of a quantity, and the places of its bifurcations on them."""

from typing import NamedTuple

import jax
import numpy as np
import xarray as xr

from .._branches.branch import Branch
from .._branches.kinds import EndKind, Kind
from .._hybrid.limits import IMPACT
from .._system.description import build_from
from .._system.family_description import system_from
from .._system.force_description import NAMED_FORCE
from .._system.parameters import is_of_force, machine_at
from .._system.system import AnySystem, ImpactSystem
from ._branch_names import checked_ordinate, quantity_lines
from ._impact_lines import OrbitImpacts, impact_lines
from ._ordinates import Ordinate

STABILITY = {True: ("-", "stable"), False: ((0, (3.0, 1.5)), "unstable")}
MARKERS: dict[str, str] = {
    Kind.FOLD: "o",
    Kind.PERIOD_DOUBLING: "D",
    Kind.NEIMARK_SACKER: "p",
    Kind.BRANCH_POINT: "*",
    Kind.PITCHFORK: "P",
    Kind.GRAZING: "v",
    Kind.DOUBLE_IMPACT: "d",
    Kind.FORCE_ZERO: "^",
    Kind.CHATTER_COMPLETION: "s",
}


class BranchLines(NamedTuple):
    """The lines of a branch at one stop, or of one quantity.

    Attributes:
        values: parameter at the points of the branch, (points,).
        kinds: bifurcation at each point, empty for none, (points,).
        is_stable: whether the branch is stable up to the next point, (points - 1,).
        lines: of each impact or quantity, the point numbers and its values there.
        is_continuous: whether the ordinate is a quantity of the cycle, which ends nowhere but where it is not known.
    """

    values: np.ndarray
    kinds: np.ndarray
    is_stable: np.ndarray
    lines: list[tuple[np.ndarray, np.ndarray]]
    is_continuous: bool


def lines_at(branch: Branch, number: int, ordinate: str, quantity: Ordinate | None) -> BranchLines:
    """The lines of the impacts of a branch at a stop, or of a quantity of a stop or a mass."""
    points = branch.points
    if branch.ends == (EndKind.CLOSED, EndKind.CLOSED):  # repeat the first point at the end
        points = points.isel(point=[*range(len(branch)), 0])
    kinds = points["bifurcation"].values.astype(str)
    # At a multiplier on the unit circle `is_stable` is decided by rounding: the other end of the segment decides.
    is_stable = points["is_stable"].values.astype(bool) | np.isin(
        kinds, [str(kind) for kind in Kind if kind.is_critical]
    )
    if quantity is None:
        sign = system_of_points(points).stops[number].sign
        found = impact_lines(_impacts(branch, points, number), kinds, points.attrs["num_periods"])
        lines = [(np.array(numbers), sign * np.array(velocities)) for numbers, velocities in found]
    else:
        lines = quantity_lines(points, ordinate, quantity, number)
    return BranchLines(
        points[branch.path].values, kinds, is_stable[:-1] & is_stable[1:], lines, quantity is not None
    )


def lines_of_branch(branch: Branch, number: int, ordinate: str) -> dict[bool, tuple[np.ndarray, np.ndarray]]:
    """Parameters and ordinates of the stable (True) and the unstable segments of a branch, separated by NaN."""
    curves = lines_at(branch, number, ordinate, checked_ordinate([branch], ordinate))
    return {is_stable: joined(curves, is_stable) for is_stable in STABILITY}


def _varied(branch: Branch) -> AnySystem:
    """Owner of the parameter of a branch: its machine as its attributes describe it, or its family."""
    if "family" not in branch.points.attrs:
        return system_of_points(branch.points)
    return branch.system or system_from(
        branch.points.attrs, allow_forces=branch.allow_forces, family=branch.family
    )


def _impacts(branch: Branch, points: xr.Dataset, stop: int) -> list[OrbitImpacts]:
    """The impacts of each orbit of a branch at a stop."""
    system, path = system_of_points(points), points.attrs["path"]
    is_still = system.stops[stop].motion is None
    system = system if is_still else _varied(branch)
    times = points.attrs["phase"] + np.cumsum(points["flight"].values, axis=1)

    def carried(value: jax.Array, angles: jax.Array) -> jax.Array:
        if is_still:
            return 0 * angles
        is_number_of_force = isinstance(system, ImpactSystem) and is_of_force(path)
        machine = system if is_number_of_force else machine_at(system, path, value)
        at = machine.stops[stop]
        if at.slot is None:  # a contact has no velocity of its own
            return 0 * angles
        return at.sign * machine.forcing.frequency * jax.vmap(at.slope_at)(angles)

    of_stop = np.asarray(jax.vmap(carried)(points[path].values, 2 * np.pi * times))
    is_hit = (points["event_kind"].values == IMPACT) & (points["event_stop"].values == stop)
    columns = (times, points["impact_speed"].values, of_stop)
    return [OrbitImpacts(*(column[k][hits] for column in columns)) for k, hits in enumerate(is_hit)]


def joined(curves: BranchLines, is_stable: bool) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and velocities of all stable or all unstable segments, separated by NaN."""
    found = [np.empty((2, 0))]
    for numbers, velocities in curves.lines:
        pieces = curves.is_stable[numbers[:-1]]
        ends = np.flatnonzero(np.diff(pieces)) + 1
        for part in np.split(np.arange(len(pieces)), ends):
            if len(part) and pieces[part[0]] == is_stable:
                whole = np.append(part, part[-1] + 1)
                drawn = np.stack([curves.values[numbers[whole]], velocities[whole]])
                found += [drawn, np.full((2, 1), np.nan)]
    x, y = np.concatenate(found, axis=1)
    return x, y


def places_of_marks(curves: list[BranchLines]) -> dict[str, list[tuple[float, float]]]:
    """Places of the bifurcations on all lines, by kind."""
    found: dict[str, list[tuple[float, float]]] = {kind: [] for kind in MARKERS}
    for one in curves:
        for numbers, velocities in one.lines:
            for value, velocity, kind in zip(
                one.values[numbers], velocities, one.kinds[numbers], strict=True
            ):
                if kind:
                    found.setdefault(str(kind), []).append((float(value), float(velocity)))
            if one.is_continuous:  # a bifurcation at which it is not known lies where its line ends
                ends = [(numbers[-1] + 1, velocities[-1])]
                ends += [(0, velocities[0])] if numbers[0] == 1 else []
                for number, beside in ends:
                    if number < len(one.kinds) and (kind := str(one.kinds[number])):
                        found.setdefault(kind, []).append((float(one.values[number]), float(beside)))
    return {kind: places for kind, places in found.items() if places}


def marks_of_branch(branch: Branch, number: int, ordinate: str) -> dict[str, list[tuple[float, float]]]:
    """Parameters and ordinates of the bifurcations of a branch, by kind."""
    return places_of_marks([lines_at(branch, number, ordinate, checked_ordinate([branch], ordinate))])


def system_of_points(points: xr.Dataset) -> ImpactSystem:
    """The machine of a branch as its attributes describe it, its force by name only."""
    system = build_from(points.attrs, force=NAMED_FORCE)  # only the stops are needed
    if system.num_stops != points.sizes["stop"]:
        raise ValueError(
            f"The machine of the branch has {system.num_stops} stops, but its points have {points.sizes['stop']}."
        )
    return system
