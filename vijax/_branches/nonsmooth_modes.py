"""Nonsmooth modes: families of periodic motions of a conservative machine, by energy.

Without losses and without a load the orbits of a machine are not isolated: each belongs to a family along which the energy changes.
A fictitious damper, that of one mass, is the parameter of a branch that keeps its value, 0: a damped orbit cannot repeat. So
the family is a branch of self-excited cycles, followed by the same walk as all others. The multiplier 1 along the family does not
make its equations singular, as the damper takes the place of the direction that it stands for.

Below the energy at which it first touches a stop a family is a mode of the linear machine, in closed form. The first point beyond is
corrected from a run of the machine at a slightly larger amplitude. A mode with a symmetry of the machine may touch several stops at
once; it is followed as that of a smaller machine, see `symmetric_subspace.py`.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
import xarray as xr

from .._dataset_attributes import variable_attributes, versions
from .._flow.taylor import TaylorFlow
from .._hybrid.limits import IMPACT
from .._jax.arrays import Count, Numbers, real_number, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._machine.laws import kinds_of_elements
from .._machine.numbers import numbers_of
from .._orbits.autonomous import with_unit
from .._orbits.rigid_modes import free_drifts, free_shifts
from .._orbits.sequence import Sequence as EventSequence, empty_sequence
from .._progress import says_what_compiles, tqdm
from .._system.family_description import attributes_of_system
from .._system.system import AnySystem, ImpactSystem, machine_of, mass_matrix
from .branch import branch_of
from .conservative import energy_of, refuse_losses
from .follow import follow_branch
from .linear_modes import LinearMode, energy_at, first_touches, linear_modes, touches, touches_several
from .padding import trimmed
from .parameter_family import ExtendedCycle, ParameterFamily
from .point import BranchPoint, DirectedBranch, PlainPoint, corrected, is_followed
from .requests import Requests, ask, simulation_from
from .scheduler import drive
from .symmetric_subspace import Subspace, multipliers_of_whole, symmetric_subspace
from .tolerances import NEGLIGIBLE, ROUNDED, TRIALS_BEYOND_TOUCH

# Room for the events of the first orbit.
_ROOM = 12
# Number of points of a linear mode, from rest to its touch.
_LINEAR = 20
# Largest energy of a family that is not told one, as a multiple of that of its touch.
_MOST = 10
# Columns that no other dataset has.
_OWN = {
    "mode": {"long_name": "number of the linear mode"},
    "energy": {"long_name": "energy"},
    "frequency": {"long_name": "angular frequency"},
    "is_stable": {"long_name": "whether no Floquet multiplier lies outside of the unit circle"},
    "x0": {"long_name": "position at a time of the motion"},
    "v0": {"long_name": "velocity at that time"},
}


@says_what_compiles
@padding_allowed
def nonsmooth_modes(
    system: AnySystem,
    max_energy: Numbers | None = None,
    *,
    modes: Sequence[Count] | None = None,
    max_points: Count = 300,
    progress: bool = True,
) -> xr.Dataset:
    """Follow the families of periodic motions of a conservative machine by energy, through impacts.

    Each linear mode continues into a family of periodic motions that hit the stops, a nonsmooth mode: the backbone of the resonances
    of the machine under a small load and little damping. Bifurcations of the family are not named; where its impacts change, as where
    another stop is touched, the family goes on with other events.

    Args:
        system: the machine, without load, damping and friction, its impacts without losses: restitution 1, or compliant stops without
            damping. At rest it touches no stop.
        max_energy: energy up to which the families are followed; ten times that at which a mode first touches a stop, if left out.
        modes: numbers of the linear modes, from 0 in the order of frequencies; all if left out.
        max_points: largest number of points of a family beyond the first touch.
        progress: show a bar.

    Returns:
        A dataset along `point`, family after family, each from rest on: `mode`, `energy`, `period`, `frequency` (angular),
        `x0` and `v0` (mass,), a state of the motion, `multipliers` (two are 1), `is_stable` (none is larger), `num_impacts` (stop,) of a
        period, `residual`, and `bifurcation`, "gr" where the events change. Attribute `ends`: why each family ends, "energy", or
        as for `vx.continuation`. A mode that touches several stops at once goes on with them where a symmetry of the machine keeps
        it; others end there, "several_impacts". Behind a later touch of two stops half a period apart the family may be one that hits
        a single one of them. Multipliers are those of the whole machine, NaN at a grazing of several stops.

    Raises:
        ValueError: for a machine that loses or gains energy, touches a stop at rest, or has another form; or if 64-bit numbers are off.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        stops = [vx.Stop(1, 1.0, "upper", 1.0)]
        system = vx.ImpactSystem([1.0, 1.0], [[0.0] * 2] * 2, [[2.0, -1.0], [-1.0, 2.0]], None, stops)
        families = vx.nonsmooth_modes(system, 5.0)
        ```

    References:
        G. Kerschen et al., Nonlinear normal modes, Part I, Mech. Syst. Signal Process. 23 (2009) 170; A. Thorin, P. Delezoide &
        M. Legrand, Nonsmooth modal analysis of piecewise-linear impact oscillators, SIAM J. Appl. Dyn. Syst. 16 (2017) 1710.
    """
    machine = machine_of(system)
    refuse_single_precision("nonsmooth_modes", machine)
    refuse_losses(machine)
    most = whole_number("max_points", max_points, 1)
    found = linear_modes(machine)
    chosen = [mode.number for mode in found] if modes is None else [whole_number("modes", k) for k in modes]
    known = {mode.number: mode for mode in found}
    if missing := [k for k in chosen if k not in known]:
        raise ValueError(f"Argument `modes` has {missing[0]}, but the modes that vibrate are {[*known]}.")
    touches = [energy_at(mode, mode.touch) for mode in known.values() if np.isfinite(mode.touch)]
    highest = (
        _MOST * max(touches, default=0.1) if max_energy is None else real_number("max_energy", max_energy)
    )
    if not 0 < highest < np.inf:
        raise ValueError(f"Argument `max_energy` must be positive, but is {highest:g}.")
    parts, ends = [], {}
    with tqdm(unit="point", disable=not progress) as bar:
        for k in chosen:
            part, ends[k] = _family(machine, known[k], found, highest, most, bar)
            parts.append(part.assign(mode=("point", np.full(part.sizes["point"], k))))
    ds = xr.concat(parts, "point", data_vars="all", coords="minimal", compat="override", join="outer")
    for name, variable in ds.variables.items():
        variable.attrs = variable_attributes(str(name)) | _OWN.get(str(name), {})
    words = ", ".join(f"{k}: {end}" for k, end in ends.items())
    return ds.assign_attrs(ends=words, **attributes_of_system(machine), **versions())


def _family(
    system: ImpactSystem, mode: LinearMode, modes: list[LinearMode], highest: float, most: int, bar: tqdm
) -> tuple[xr.Dataset, str]:
    """A family, and why it ends."""
    reached = np.sqrt(2 * highest) / mode.frequency
    linear = _linear_part(system, mode, modes, min(mode.touch, reached))
    if mode.touch >= reached:
        return linear, "energy"
    symmetric = symmetric_subspace(system, mode.shape)
    if symmetric is None:
        beyond, end = _beyond(system, mode, highest, most, bar)
    else:
        own = mode._replace(shape=symmetric.basis.T @ mode.shape)
        beyond, end = _beyond(symmetric.system, own, highest, most, bar)
        beyond = None if beyond is None else _of_whole(beyond, system, symmetric)
    parts = [linear] if beyond is None else [linear, beyond]
    return xr.concat(parts, "point", join="outer", data_vars="all"), end


def _beyond(
    system: ImpactSystem, mode: LinearMode, highest: float, most: int, bar: tqdm
) -> tuple[xr.Dataset | None, str]:
    """The part of a family beyond its first touch, and why it ends."""
    if touches_several(system, mode):
        return None, "several_impacts"
    family = _parameter_family(system, mode)
    (start,) = drive([family], [_first_beyond(family, system, mode)], lambda: None)
    if start is None:
        return None, "not_converged"
    walk = DirectedBranch(family.last_phase, (-1.0, 1.0), most)
    start = start if _leaves_touch(start) else start.turned()
    num_drawn = 0

    def tell() -> None:
        nonlocal num_drawn
        for point in walk.points[num_drawn:]:
            if walk.last is None and _energy_of(system, point) > highest:
                walk.last = point.arc
        bar.update(len(walk.points) - num_drawn)
        num_drawn = len(walk.points)

    drive([family], [follow_branch(walk, start)], tell)
    end = "energy" if walk.last is not None else str(walk.end)
    points = branch_of(family, start, DirectedBranch(walk.num_periods, walk.bounds, 0), walk).points
    energies = [_energy_of(system, point) for point in [start, *walk.all_points()]]
    return _columns(points, energies), end


def _of_whole(beyond: xr.Dataset, system: ImpactSystem, symmetric: Subspace) -> xr.Dataset:
    """Points of the whole machine from those of the smaller one that its symmetric motions make."""
    x, v = (symmetric.states(beyond[name].values) for name in ("x0", "v0"))
    multipliers = multipliers_of_whole(system, beyond["period"].values, x, v)
    counts = symmetric.counts(beyond["num_impacts"].values)
    kept = beyond.drop_vars(["x0", "v0", "multipliers", "num_impacts", "is_stable"])
    return kept.assign(
        x0=(("point", "mass"), x),
        v0=(("point", "mass"), v),
        multipliers=(("point", "multiplier"), multipliers),
        is_stable=("point", _are_on_circle(multipliers)),
        num_impacts=(("point", "stop"), counts),
    )


def _linear_part(system: ImpactSystem, mode: LinearMode, modes: list[LinearMode], last: float) -> xr.Dataset:
    """Points of a linear mode up to an amplitude."""
    amplitudes = last * np.sqrt(np.arange(1, _LINEAR + 1) / _LINEAR)
    period, n = 2 * np.pi / mode.frequency, len(mode.shape)
    angles = np.array([one.frequency * period for one in modes])
    multipliers = np.exp(1j * np.concatenate([angles, -angles]))
    multipliers = np.append(multipliers, np.ones(2 * n - len(multipliers)))
    kinds = np.full(_LINEAR, "", "U32")
    kinds[-1] = "gr" if last == mode.touch else ""
    full = lambda a: np.broadcast_to(a, (_LINEAR, *np.shape(a)))  # noqa: E731
    return xr.Dataset(
        {
            "energy": ("point", energy_at(mode, amplitudes)),
            "period": ("point", full(period)),
            "frequency": ("point", full(mode.frequency)),
            "x0": (("point", "mass"), amplitudes[:, None] * mode.shape),
            "v0": (("point", "mass"), 0 * full(mode.shape)),
            "multipliers": (("point", "multiplier"), full(multipliers)),
            "is_stable": ("point", full(True)),
            "num_impacts": (("point", "stop"), np.zeros((_LINEAR, len(system.stops)), int)),
            "residual": ("point", np.zeros(_LINEAR)),
            "bifurcation": ("point", kinds),
        }
    )


def _columns(points: xr.Dataset, energies: list[float]) -> xr.Dataset:
    """Points beyond the touch, with the columns of those before it."""
    kept = points[["period", "x0", "v0", "multipliers", "num_impacts", "residual", "bifurcation"]].drop_vars(
        [points.attrs["path"]], errors="ignore"
    )
    return kept.assign(
        energy=("point", np.array(energies)),
        frequency=("point", 2 * np.pi / points["period"].values),
        is_stable=("point", _are_on_circle(points["multipliers"].values)),
    ).drop_attrs()


def _are_on_circle(multipliers: np.ndarray) -> Any:
    """True where no multiplier lies outside of the unit circle."""
    finite = np.where(np.isfinite(multipliers), np.abs(multipliers), np.inf)
    return (finite < 1 + NEGLIGIBLE).all(axis=1)


def _parameter_family(system: ImpactSystem, mode: LinearMode) -> ParameterFamily:
    """The machine with a fictitious damper, on the mass that moves most."""
    moved = int(np.argmax(np.abs(mode.shape)))
    unit = 2 * np.pi / mode.frequency
    own = jax.tree.map(np.asarray, with_unit(system, unit))
    numbers, dtype = numbers_of(own), own.stiffness.dtype
    length = mode.touch * np.abs(mode.shape).max()
    scale = length * np.repeat([1.0, mode.frequency], len(mode.shape))
    return ParameterFamily(
        system=own,
        flow=TaylorFlow(),
        num_periods=np.asarray(1, dtype),
        phase=np.asarray(0, dtype),
        scale=scale.astype(dtype),
        span=np.asarray(mode.frequency * mass_matrix(system.mass)[moved, moved], dtype),
        tolerance=np.asarray(0, dtype),
        shifts=np.asarray(free_shifts(numbers)),
        drift=jax.tree.map(np.asarray, free_drifts(numbers)),
        path=f"damping[{moved}][{moved}]",
        is_autonomous=True,
    )


def _first_beyond(
    family: ParameterFamily, system: ImpactSystem, mode: LinearMode
) -> Requests[BranchPoint | None]:
    """The first orbit of a family that hits a stop; None if Newton's method finds none."""
    room = empty_sequence(_ROOM, tuple(kinds_of_elements(system)))
    room = jax.tree.map(np.asarray, room)
    for more in TRIALS_BEYOND_TOUCH:
        # From the middle of the swing, over the period of the linear mode.
        fast = mode.frequency * mode.touch * (1 + more) * mode.shape
        followed = yield from ask(simulation_from(room, np.concatenate([0 * fast, fast]), 0.0))
        count = int(np.count_nonzero(followed.sequence.kind >= 0))
        if not 0 < count < _ROOM:
            continue
        sequence, flights = trimmed(followed.sequence, count), np.array(followed.flights[:count])
        state = np.asarray(followed.z)
        flights[0] = _first_flight(system, mode, 1 + more, state)
        if (other := _other_end(system, mode, sequence)) is not None:
            # The first impact of the run throws it off its way to the other end, where the family has one as well.
            sequence = _impacts_at(sequence, [other, int(sequence.stop[-1])])
            flights = np.full(2, _first_flight(system, mode, 1 + more, state, other))
        z = _as_reversible(system, state, int(sequence.stop[-1]))
        place = ExtendedCycle(z, flights, np.asarray(0.0))
        # The velocity after the event is kept: the family goes on behind the touch to orbits that no machine follows.
        velocity = np.where(np.arange(len(place.z)) < len(fast), 0, place.z)
        weights = ExtendedCycle(velocity / np.linalg.norm(velocity), 0 * place.flights, np.asarray(0.0))
        cycle = yield from corrected(sequence, place, weights, place.along(weights))
        point = BranchPoint.of(sequence, cycle, 0.0)
        is_family = cycle.found.is_converged and abs(float(cycle.found.place.p)) < ROUNDED
        if is_family and (yield from is_followed(point)):
            return point
    return None


def _other_end(system: ImpactSystem, mode: LinearMode, sequence: EventSequence) -> int | None:
    """The stop that a mode touches first at the other end of the swing than the last impact; None if there is none."""
    first = {one.stop: one.is_ahead for one in first_touches(system, mode)}
    last = int(sequence.stop[-1])
    if sequence.kind[-1] != IMPACT or last not in first:
        return None
    return next((stop for stop, is_ahead in first.items() if is_ahead != first[last]), None)


def _impacts_at(sequence: EventSequence, stops: list[int]) -> EventSequence:
    """A sequence of impacts at stops, free between them, for one that begins with a free flight."""
    mode = np.repeat(sequence.mode[:1], len(stops) + 1, axis=0)
    return EventSequence(np.full(len(stops), IMPACT), np.array(stops), mode)


def _first_flight(
    system: ImpactSystem, mode: LinearMode, beyond: float, z: np.ndarray, stop: int | None = None
) -> float:
    """Duration of the first flight of a cycle, in periods of the linear mode: from its last event to its first.

    That is the time from the last event to the middle of the swing, by the mode alone, and from there to the first touch. A
    run over the period of the linear mode is too long by what each contact cuts off: with that much, Newton's method may
    find a cycle that arrives at the stops from behind.

    Args:
        system: the machine.
        mode: the mode.
        beyond: amplitude, as a multiple of that of the touch.
        z: state after the last event, scaled.
        stop: the stop of the first event; that which the mode touches first, if left out.
    """
    amplitude = mode.touch * beyond
    until = min(
        np.arcsin(one.amplitude / amplitude) + (0 if one.is_ahead else np.pi)
        for one in touches(system, mode.shape)
        if one.amplitude < amplitude and stop in (None, one.stop)
    )
    x, v = (mode.shape @ mass_matrix(system.mass) @ a for a in np.split(z, 2))
    return float((until - np.arctan2(x, v)) % (2 * np.pi) / (2 * np.pi))


def _as_reversible(system: ImpactSystem, z: np.ndarray, stop: int) -> np.ndarray:
    """A state just after a light contact with a stop, with the velocities that its impulse alone gives.

    The family is made of motions that run backwards as they run forwards, so nothing else moves there.
    """
    x, v = np.split(z, 2)
    row = np.zeros_like(x)
    for mass, coefficient in system.stops[stop].coefficients.items():
        row[mass] = float(coefficient)
    along = np.linalg.solve(mass_matrix(system.mass), row)
    return np.concatenate([x, along * (row @ v) / (row @ along)])


def _energy_of(system: ImpactSystem, point: BranchPoint | PlainPoint) -> float:
    """Energy of a point of a family."""
    own: Any = point.alone() if isinstance(point, PlainPoint) else point
    return energy_of(system, np.asarray(own.cycle.start))


def _leaves_touch(point: BranchPoint) -> bool:
    """True if the speed at which the machine meets the stop grows along the tangent."""
    speeds = point.cycle.found.speeds
    k = int(np.argmax(np.abs(speeds)))
    return bool(point.cycle.rates.speeds[k] * speeds[k] > 0)
