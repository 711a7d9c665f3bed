"""Small calls that need the programs of large ones.

A program serves all machines of a kind, all values, times and numbers of points. So the programs of a call are those
of the same call with two points, or along a short branch. To call it is surer than to list its programs here, and it
stays true when they change.
"""

from math import isfinite

import numpy as np

from .._attractors.basins import basins
from .._branches.branch import Branch
from .._branches.continuation import continuation
from .._branches.curve import bifurcation_curve
from .._orbits.orbit import PeriodicOrbit
from .._orbits.periodic_orbit import periodic_orbit
from .._sections.lyapunov import lyapunov_exponents
from .._sweep.sweep import sweep
from .._system.contact import whole_row
from .._system.family import Family
from .._system.parameters import get_parameter, is_parameter, set_parameter
from .._system.system import AnySystem, ImpactSystem, machine_of
from .._trajectory.simulate import simulate

# `_PERIODS`: in which the machine settles. `_MOST_PERIODS`: of an orbit that is looked for.
# `_WIDTH`: how far branches and curves go to either side, relative to the parameter. `_POINTS`: their most points there.
_PERIODS, _MOST_PERIODS, _WIDTH, _POINTS = 200, 4, 0.4, 60
# The parameter of a branch is the first of these that the machine has, that of a curve the next one.
_PATHS = (
    "forcing.frequency",
    "stops[0].position",
    "forcing.amplitude[0]",
    "friction[0].force",
    "stiffness[0,0]",
    "damping[0,0]",
)
# Factors of the first parameter at which an orbit is looked for: another machine of the kind has the same programs.
_FACTORS = 1.0, 0.9, 1.1, 0.8, 1.25, 0.65
_CURVES = "fold", "pd", "ns", "gr"
# Difference between two starts.
_SMALL = 1e-6
# Most stops onto which a start is moved, one after the other.
_ROUNDS = 200


class NothingFound(RuntimeError):
    """No orbit, or no bifurcation, from which a call could go on: its programs are not made."""


class Rehearsal:
    """Small calls of a machine, each done once.

    Args:
        system: the machine.
    """

    def __init__(self, system: AnySystem):
        self.system = system
        self._orbit: PeriodicOrbit | None = None
        self._branch: Branch | None = None

    def simulate(self) -> None:
        """One trajectory, from rest."""
        simulate(self.system, 0.0, _period(self.system), *_start(self.system), throw=False)

    def sweep(self) -> None:
        """Two points."""
        x, v = _start(self.system)
        sweep(self.system, {"v0[0]": [0.0, _SMALL]}, transient=1, record=1, x0=x, v0=v, progress=False)

    def basins(self) -> None:
        """Four starts."""
        x, v = _start(self.system)
        moved = x + _SMALL * np.eye(len(x))[0]
        away = -_SMALL if _smallest_gap(machine_of(self.system), moved)[0] < 0 else _SMALL
        grid = {"x0[0]": [x[0], x[0] + away], "v0[0]": [0.0, _SMALL]}
        basins(self.system, grid, transient=10, x0=x, v0=v, progress=False)

    def lyapunov_exponents(self) -> None:
        """Two periods."""
        start = _start(self.system)
        lyapunov_exponents(self.system, *start, transient=1, num_periods=2, throw=False, progress=False)

    def periodic_orbit(self) -> None:
        """The orbit on which the machine settles."""
        self._settled()

    def continuation(self) -> None:
        """A short branch through it."""
        self._followed()

    def bifurcation_curve(self) -> None:
        """A few points of the curve of each kind of bifurcation on that branch."""
        branch = self._followed()
        by_kind = {point.kind: point for point in branch.bifurcations if point.kind in _CURVES}
        paths = _paths(self.system)
        if not by_kind or len(paths) < 2:
            raise NothingFound("the branch has no bifurcation whose curve could be followed")
        for point in by_kind.values():
            bounds = {path: _bounds(self.system, path) for path in paths[:2]}
            bifurcation_curve(point, paths[1], bounds, max_points=3, progress=False)

    def _settled(self) -> PeriodicOrbit:
        """An orbit on which the machine, or another one of its kind, settles from rest."""
        self._orbit = self._orbit or _orbit_near(self.system)
        return self._orbit

    def _followed(self) -> Branch:
        if self._branch is None:
            orbit, path = self._settled(), _paths(self.system)[0]
            bounds = _bounds(orbit.system, path)
            self._branch = continuation(orbit, path, bounds, max_points=_POINTS, progress=False)
        return self._branch


def rehearse(system: AnySystem, calls: tuple[str, ...]) -> dict[str, str]:
    """Make small calls of a machine, and return for each one that could not go to its end why."""
    rehearsal, failed = Rehearsal(system), {}
    for call in calls:
        try:
            getattr(rehearsal, call)()
        except (ValueError, RuntimeError) as error:
            failed[call] = str(error)
    return failed


def _orbit_near(system: AnySystem) -> PeriodicOrbit:
    path = _paths(system)[0]
    for factor in _FACTORS:
        one = set_parameter(system, path, factor * np.asarray(get_parameter(system, path)))
        x, v = _start(one)
        settled = simulate(one, 0.0, _PERIODS * _period(one), x, v, max_events=1, throw=False)
        x, v = np.asarray(settled.x1), np.asarray(settled.v1)
        if not np.isfinite([x, v]).all():
            continue
        for num_periods in range(1, _MOST_PERIODS + 1):
            orbit = periodic_orbit(one, x, v, num_periods, throw=False)
            if orbit.is_admissible:
                return orbit
    raise NothingFound(
        f"the machine settles on no orbit of 1 to {_MOST_PERIODS} periods from rest, also with `{path}` changed"
    )


def _paths(system: AnySystem) -> list[str]:
    """Parameters that are single numbers other than 0."""
    if isinstance(system, Family):
        names = [name for name, a in system.values.items() if not np.ndim(a)]
    else:
        names = [path for path in _PATHS if is_parameter(system, path)]
    return [name for name in names if get_parameter(system, name)]


def _bounds(system: AnySystem, path: str) -> tuple[float, float]:
    value = float(get_parameter(system, path))
    return value - _WIDTH * abs(value), value + _WIDTH * abs(value)


def _period(system: AnySystem) -> float:
    """Forcing period of a machine, or a radian of its fastest motion if it has none."""
    machine = machine_of(system)
    frequency = machine.forcing.frequency
    period = np.inf if frequency is None or not frequency > 0 else 2 * np.pi / float(frequency)
    rates = np.diagonal(np.asarray(machine.stiffness)) / np.max(np.asarray(machine.mass))
    return period if isfinite(period) else 1 / np.sqrt(max(float(rates.max()), 1e-6))


def _start(system: AnySystem) -> tuple[np.ndarray, np.ndarray]:
    """A start at rest between all stops, at 0 if that is."""
    machine = machine_of(system)
    x, still = np.zeros((2, machine.num_masses))
    for _ in range(_ROUNDS):
        gap, row = _smallest_gap(machine, x)
        if gap >= 0:
            break
        x = x + row * (1.001 * gap) / (row @ row)
    return x, still


def _smallest_gap(machine: ImpactSystem, x: np.ndarray) -> tuple[float, np.ndarray]:
    """Smallest gap at the start of a period, and the row of its stop or contact."""
    found = min(
        ((float(stop.gap(x, 0.0)), k) for k, stop in enumerate(machine.stops) if not stop.is_compliant),
        default=(0.0, -1),
    )
    coefficients = machine.stops[found[1]].coefficients if found[1] >= 0 else {}
    return found[0], whole_row(coefficients, len(x))
