"""Result of `continuation`: a branch of periodic orbits and its bifurcations."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._dataset_checks import check_columns, finite_attribute, parsed_attribute
from .._orbits.orbit import PeriodicOrbit
from .._orbits.sequence import Sequence
from .._system.family import Family
from .._system.family_description import system_from
from .._system.forces_by_path import Allowed
from .._system.system import AnySystem, bound
from .branch_columns import dataset_of
from .branch_orbits import OF_SEQUENCE, orbit_at, sequence_at
from .kinds import MONITOR
from .parameter_family import ExtendedCycle, ParameterFamily
from .point import BranchPoint, DirectedBranch

# Columns from which an orbit is built, and their dimensions.
_OF_ORBITS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("is_stable", "is_admissible", "residual"), ("point",)),
    **dict.fromkeys(("x0", "v0"), ("point", "mass")),
    **dict.fromkeys(("event_kind", "event_stop", "flight"), ("point", "event")),
    "num_impacts": ("point", "stop"),
    "multipliers": ("point", "multiplier"),
    "held": ("point", "flight_number", "stop"),
    "start": ("point", "state"),
}


@dataclass(frozen=True, eq=False)
class Branch:
    """Periodic orbits along a parameter.

    Attributes:
        points: a Dataset along `point`, in the order of arclength; `branch.points.to_netcdf(file)` saves a branch, and
            `vx.Branch(xr.open_dataset(file))` restores it.
        system: the machine of its orbits, whose own value of the parameter is not used; if left out, it is built from
            the attributes of `points` when an orbit is requested.
        allow_forces: modules from which the `force` of that machine may be imported, as for `vx.system_of`.
        force: the force of that machine, as for `vx.system_of`.
        family: the function of the family whose value was varied, as for `vx.system_of`.
    """

    points: xr.Dataset
    system: AnySystem | None = None
    allow_forces: Allowed = field(default=False, kw_only=True)
    force: Callable | None = field(default=None, kw_only=True)
    family: Callable | Family | None = field(default=None, kw_only=True)

    def __post_init__(self):
        if self.system is not None and self.force is not None:
            raise ValueError("Give `vx.Branch` the machine, or its force, not both.")

    def __getattr__(self, name: str) -> Any:
        """`points` of a branch just followed: the dataset is made when it is first read, see `branch_of`."""
        if name != "points" or "dataset_of" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        points = self.__dict__["dataset_of"]()
        object.__setattr__(self, "points", points)
        del self.__dict__["dataset_of"]
        return points

    def __getstate__(self) -> dict[str, Any]:
        self.points  # noqa: B018
        return self.__dict__

    @property
    def path(self) -> str:
        """Path of the parameter."""
        _check(self.points)
        return self.points.attrs["path"]

    @property
    def values(self) -> np.ndarray:
        """Values of the parameter along the branch, (points,)."""
        return self.points[self.path].values

    @property
    def ends(self) -> tuple[str, str]:
        """Reasons why the branch ends at its first point and at its last."""
        _check(self.points)
        first, last = json.loads(self.points.attrs["ends"])
        return first, last

    @property
    def bifurcations(self) -> list["Bifurcation"]:
        """Bifurcations of the branch, in their order."""
        return [point for point in self.special_points if not point.kind.startswith(MONITOR)]

    @property
    def special_points(self) -> list["Bifurcation"]:
        """Bifurcations of the branch and zeros of its monitors, in their order."""
        _check(self.points)
        return [Bifurcation(self, int(k)) for k in np.flatnonzero(self.points["bifurcation"].values != "")]

    @property
    def peaks(self) -> list["Peak"]:
        """Peaks of the quantities that `vx.continuation` was given as `peaks`, in their order; none without."""
        _check(self.points)
        if "peak" not in self.points:
            return []
        return [Peak(self, int(k)) for k in np.flatnonzero(self.points["peak"].values != "")]

    def orbit(self, k: int) -> PeriodicOrbit:
        """Return the orbit at point `k`."""
        system = self.system or system_from(
            self.points.attrs, allow_forces=self.allow_forces, force=self.force, family=self.family
        )
        _check(self.points)
        _check_orbits(self.points, system)
        if not -len(self) <= k < len(self):
            raise IndexError(f"The branch has {len(self)} points, so there is no point {k}.")
        return orbit_at(jax.tree.map(jnp.asarray, bound(system)), self.points.isel(point=k))

    def __len__(self) -> int:
        return self.points.sizes.get("point", 0)

    def __repr__(self) -> str:
        low, high = self.values.min(), self.values.max()
        places = [f"{point.kind} {point.value:.9g}" for point in self.special_points]
        zeros = [words.removeprefix(MONITOR) for words in places if words.startswith(MONITOR)]
        kinds = ", ".join(words for words in places if not words.startswith(MONITOR))
        stable = int(self.points["is_stable"].sum())
        return (
            f"Branch of {len(self)} periodic orbits, {stable} stable\n"
            f"  {self.path}  {low:.9g} to {high:.9g}\n"
            f"  ends          {self.ends[0]}, {self.ends[1]}\n"
            f"  bifurcations  {kinds or 'none'}" + (f"\n  monitors      {', '.join(zeros)}" if zeros else "")
        )


def _check(points: xr.Dataset) -> None:
    """Reject a dataset that is no branch."""
    path, ends = points.attrs.get("path"), parsed_attribute(points, "ends")
    is_path = isinstance(path, str) and path in points.variables
    are_ends = isinstance(ends, list) and len(ends) == 2 and all(isinstance(end, str) for end in ends)
    n, phase = (finite_attribute(points, name) for name in ("num_periods", "phase"))
    is_cycle = n is not None and 0 <= n < 2**31 and n == int(n) and phase is not None
    if not (is_path and are_ends and is_cycle):
        names = "`path`, `ends`, `num_periods` and `phase`"
        raise ValueError(
            f"The attributes {names} of the dataset are not those of a branch: pass `branch.points`."
        )
    check_columns(points, "`branch.points`", dict.fromkeys((str(path), "is_stable"), ("point",)))
    is_text = points["bifurcation"].dtype.kind in "UTSO" if "bifurcation" in points else False
    if not (is_text and points["bifurcation"].dims == ("point",) and points.sizes["point"]):
        raise ValueError(
            "The dataset has no points with the column `bifurcation`, a text: pass `branch.points`."
        )


def _check_orbits(points: xr.Dataset, system: AnySystem) -> None:
    """Reject a branch from which no orbit of the machine can be built."""
    period = {} if points.attrs["num_periods"] else {"period": ("point",)}
    check_columns(points, "`branch.points`", _OF_ORBITS | period)
    sizes, n = points.sizes, system.num_coordinates
    counts = {"mass": n, "stop": system.num_stops, "state": 2 * n, "flight_number": sizes["event"] + 1}
    for dim, count in counts.items():
        if sizes[dim] != count:
            raise ValueError(
                f"A branch of this machine has {count} along `{dim}`, but this one has {sizes[dim]}."
            )


@dataclass(frozen=True, eq=False, repr=False)
class Bifurcation:
    """Bifurcation on a branch, or another special point of it.

    Attributes:
        branch: the branch.
        index: number of the point on it.
    """

    branch: "Branch"
    index: int

    @property
    def kind(self) -> str:
        """Kind of the bifurcation; a zero of a monitor has the prefix "monitor" and the name, with a colon between.

        One of "fold", "pd" (period doubling), "ns" (Neimark-Sacker), "pitchfork" (the orbits lose or regain
        a symmetry of the machine), "bp" (another branch point, also where a doubled branch
        meets the orbit of half its period), "gr" (grazing), "double_impact" (at two stops at once), "force_zero" (the
        contact force of a held mass touches zero), "chatter_completion" (a stick appears or disappears); of friction
        "crossing_sliding" (a turn becomes a stick), "grazing_sliding" (a slide touches velocity zero, and sticks),
        "switching_sliding" (a stick begins at its other bound), "adding_sliding" (a stick is split by a slip).
        """
        return str(self.branch.points["bifurcation"].values[self.index])

    @property
    def value(self) -> float:
        """Value of the parameter."""
        return float(self.branch.values[self.index])

    @property
    def orbit(self) -> PeriodicOrbit:
        """Orbit at the bifurcation."""
        return self.branch.orbit(self.index)

    @cached_property
    def normal_form(self) -> Any:  # a `NormalForm` or a `GrazingForm`; type checkers would ask for the one
        """Normal form of a "fold", "pd", "ns", "pitchfork" or "gr", which tells what the machine does beside the point, to leading order.

        Its `criticality` tells whether the orbits that branch off are stable, its `side` where they exist, its `amplitude` how
        far they are, see `vx.NormalForm`. It is made of the second and third derivatives of the return map, which exist through
        all events, as no impact grazes there. At a grazing it is the square root that the stop adds to the map, see
        `vx.GrazingForm`. The first call compiles them.

        Raises:
            ValueError: for another kind, for a grazing of several impacts at once, or of one that stops friction or tears it off
                however light it is, or if 64-bit numbers are off.

        References:
            Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sec. 5.4.
        """
        from .normal_form import normal_form_of  # which needs this class

        return normal_form_of(self)

    @property
    def criticality(self) -> str:
        """Criticality of a "pd", "ns" or "pitchfork", "supercritical" or "subcritical", "" for a fold; see `normal_form`."""
        return self.normal_form.criticality

    def __repr__(self) -> str:
        return f"{self.kind} at {self.value:.12g} (point {self.index})"


def branch_of(
    family: ParameterFamily, start: BranchPoint, back: DirectedBranch, forth: DirectedBranch
) -> Branch:
    """Join the walks backwards and forwards from a point to a branch, whose dataset is made when it is first read."""
    branch = object.__new__(Branch)
    walks = [replace(walk, points=walk.all_points(), monitored=[], cascade=[]) for walk in (back, forth)]
    own = {"system": family.system, "allow_forces": False, "force": None, "family": None}
    branch.__dict__.update(own, dataset_of=partial(dataset_of, family, start, *walks))
    return branch


class Peak(Bifurcation):
    """Peak of a quantity along a branch, as a resonance.

    Attributes:
        branch: the branch.
        index: number of the point on it.
    """

    @property
    def kind(self) -> str:
        """Kind of the peak along the branch, "maximum" or "minimum"."""
        return str(self.branch.points["peak"].values[self.index])

    @property
    def quantity(self) -> str:
        """The quantity with the number of its mass, as "max_position[0]"."""
        return str(self.branch.points["peak_quantity"].values[self.index])

    @property
    def height(self) -> float:
        """The quantity at the peak."""
        return float(self.branch.points["peak_height"].values[self.index])

    @property
    def event(self) -> str:
        """Kind of the bifurcation at which the quantity has a kink, as "gr"; "" where it is smooth."""
        return str(self.branch.points["peak_event"].values[self.index])

    def __repr__(self) -> str:
        return f"{self.kind} {self.height:.12g} of {self.quantity} at {self.value:.12g} (point {self.index})"


def cycle_of(point: Bifurcation, scale: np.ndarray, p: float) -> tuple[Sequence, ExtendedCycle]:
    """Sequence and extended cycle of a bifurcation, its state divided by `scale`, its parameter set to `p`."""
    points = point.branch.points  # not `isel`, which takes milliseconds
    names = ("start", "flight", *OF_SEQUENCE)
    at = {name: points[name].values[point.index] for name in names if name in points}
    num_events = int(np.count_nonzero(at["event_kind"] >= 0))
    flights = at["flight"][:num_events]
    return sequence_at(at, num_events), ExtendedCycle(at["start"] / scale, flights, np.asarray(p))
