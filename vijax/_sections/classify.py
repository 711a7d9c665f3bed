"""Kind of motion: number of impacts in a number of forcing periods, or no repetition."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from .._dataset_attributes import flags
from .._dataset_checks import check_columns, check_is_dataset
from .._sweep.outcomes import warn_of_endings
from .._sweep.recurrence import TOLERANCES, Recurrence, recurrence
from .._sweep.unsettled import warn_of_unsettled
from .._trajectory.solution import Solution
from .non_impacting_proof import prove_non_impacting
from .record import (
    Impacts,
    flattened_points,
    forcing_periods,
    has_full_mass,
    has_tied_friction,
    impacts_of,
    labelled,
    machines,
    stop_masses,
)
from .section_side import after_impacts, before_impact, padded_to_power_of_two
from .sections import stroboscopic_section

MOTIONS: Final = ("non_impacting", "periodic", "chattering", "non_periodic", "not_settled", "failed")
# An impact this close before the end of a period, as a fraction of the period, counts as one just after it. Otherwise
# some periods of a cycle with an impact there would end before it and some after it.
_EDGE = 1e-3


def classify(
    source: Solution | xr.Dataset,
    *,
    tolerance: float | None = None,
    double_impact_within: float | None = None,
    last: int | None = None,
) -> xr.Dataset:
    """Classify each motion: whether it repeats, after how many forcing periods, and with how many impacts.

    A motion repeats after n forcing periods if its state at the end of each period equals that n periods before; an
    (m, n) motion has m impacts in them. From `record` periods n is found up to record / 2, but only up to record / 4
    while the motion still settles: a longer period looks like chaos.

    Where nothing is hit, and the machine is stored and linear, under loads that repeat, the section does not decide. Instead the periodic
    response to the load and the remaining free vibration are computed. If the response stays between the stops, every
    mode is damped, no force feeds energy in, and the energy of the free vibration cannot carry any mass to a stop, the motion is `non_impacting`
    with n = 1 however slowly it settles, whatever the `tolerance`.

    A motion with a long period, up to record / 2, looks like chaos until it repeats. In a sweep with `lyapunov=True`
    the largest exponent separates the two: a motion that does not repeat is `non_periodic` if the exponent is positive
    by three standard errors, and `not_settled` if it is negative by three.

    Args:
        source: result of `vx.simulate` or `vx.sweep`.
        tolerance: largest distance of a motion from the cycle on which it settles, relative to its size;
            1e-6, or 1e-3 in single precision, if left out.
        double_impact_within: impacts of different masses closer than this, in units of time, are a double
            impact; a thousandth of the forcing period if left out.
        last: number of last forcing periods that are compared. If left out, all that a sweep recorded,
            and the second half of a trajectory.

    Returns:
        With the dimensions of the sweep,
        `motion`: `non_impacting` (and periodic, or about to be, see above), `periodic`, `chattering` (periodic, with a
        complete chatter), `non_periodic`, `not_settled` (approaching a cycle, or close to one, but not on it), or
        `failed`, as numbers named by its attributes;
        `num_periods`: n, 0 if the motion does not repeat;
        `num_impacts` (..., stop): m, infinite for a complete chatter;
        `held_time` (..., stop): time in n periods during which each stop holds its mass;
        `num_double_impacts`: double impacts in n periods, pairs of impacts of different masses next to each other in
        time;
        `recurrence_error`: the largest change of the state in n periods, relative to the size of the motion, and
        `contraction`, the factor by which it falls from period to period, NaN if unknown. Where the motion does not
        repeat, both are those of the n with the least error; where the machine decides, `contraction` is the exact
        factor of its slowest mode, exp(T max Re lambda).
        Values for n periods are NaN if there is no n. Counts are NaN if the log was cut, with a warning. Another warning counts
        the motions that have not settled.

    Raises:
        ValueError: if fewer than two periods are recorded, the load has no frequency, or an argument is not positive.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import numpy as np, vijax as vx
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), {"forcing.frequency": np.arange(0.2, 2.0, 0.01)})
        motions = vx.classify(ds)
        ```

    References:
        Wagg & Bishop (2004), Sec. 4.4 with Table 2, Sec. 4.5 with Table 3.
    """
    if not isinstance(source, Solution):
        check_is_dataset(source, "source", "`vx.sweep`")
        warn_of_endings(source, "max_impacts_reached")
    found = classified(source, tolerance, double_impact_within, last)
    warn_of_unsettled_motions(found, tolerance, _section(source, last)[1])
    return found


def _tolerance(like: Any, tolerance: float | None) -> float:
    return TOLERANCES[like.dtype.itemsize] if tolerance is None else tolerance


def warn_of_unsettled_motions(found: xr.Dataset, tolerance: float | None, record: int) -> None:
    """Warn of the motions that have not settled, with the time that they still take as far as it is known.

    Args:
        found: `motion`, `num_periods`, `recurrence_error` and `contraction` as `classify` returns them.
        tolerance: that of `classify`.
        record: number of periods that were compared.
    """
    is_so = found["motion"].values == MOTIONS.index("not_settled")
    n, error, factor = (found[name].values for name in ("num_periods", "recurrence_error", "contraction"))
    trend = Recurrence(n, error, factor, is_so)
    warn_of_unsettled(trend, _tolerance(error, tolerance), record, "`transient` or `t1`")


def classified(
    source: Solution | xr.Dataset,
    tolerance: float | None = None,
    double_impact_within: float | None = None,
    last: int | None = None,
) -> xr.Dataset:
    """As `classify`, without a warning."""
    section, last = _section(source, last)
    tolerance = _tolerance(section.v, tolerance)
    for name, value in (("tolerance", tolerance), ("double_impact_within", double_impact_within)):
        if value is not None and not value > 0:
            raise ValueError(f"Argument `{name}` must be positive, but is {value}.")
    period, masses, impacts = forcing_periods(source), stop_masses(source), impacts_of(source)
    in_periods = impacts.time / period[impacts.point]
    number = np.floor(in_periods + _EDGE).astype(int)  # index of the period of each impact, from 0
    v = _on_one_side(source, section, masses, impacts, number, in_periods)
    relative = _relative(section.x.values, v, 2 * np.pi / period, impacts)[:, -last:]
    is_failed = np.isnan(relative.sum(axis=(1, 2)))
    found = recurrence(np.where(is_failed[:, None, None], 0, relative), tolerance)
    is_cut = _is_cut(source, impacts, len(period))
    is_asked = ~(is_failed | is_cut | _is_touched(section, impacts, number, last))
    found = _with_proved_non_impacting(source, found, section, np.flatnonzero(is_asked), relative)
    found = _with_exponents(source, found)
    n = np.where(is_failed, 0, found.num_periods)
    tally = _tally(section, impacts, number, n, masses)
    within = period / 1000 if double_impact_within is None else np.full(len(n), double_impact_within)
    doubles = _double_impacts(impacts, tally.is_ours, masses, within)
    is_counted = (n > 0) & ~is_cut
    columns = {
        "motion": ((), _motion(n, is_failed, found.is_settling, tally, is_cut)),
        "num_periods": ((), n),
        "num_impacts": (("stop",), np.where(is_counted[:, None], tally.num_impacts, np.nan)),
        "held_time": (("stop",), np.where((n > 0)[:, None], tally.held_time, np.nan)),
        "num_double_impacts": ((), np.where(is_counted, doubles, np.nan)),
        "recurrence_error": ((), np.where(is_failed, np.nan, found.error)),
        "contraction": ((), np.where(is_failed, np.nan, found.contraction)),
    }
    ds = labelled(source, columns)
    ds["motion"].attrs = flags(MOTIONS)
    return ds


class _PeriodCounts(NamedTuple):
    """Impacts and held times of the last n periods.

    Attributes:
        is_ours: flags of the impacts in them.
        num_impacts: impacts of each stop, infinite where a complete chatter ends, (points, stops).
        held_time: held time of each stop, (points, stops).
    """

    is_ours: np.ndarray
    num_impacts: np.ndarray
    held_time: np.ndarray


def _section(source: Solution | xr.Dataset, last: int | None) -> tuple[xr.Dataset, int]:
    """The section as (point, period, mass or stop), and the number of periods that are compared."""
    section = stroboscopic_section(source)
    recorded = section.sizes["period"]
    if last is None:
        last = recorded if isinstance(source, xr.Dataset) else -(-recorded // 2)
    if not 2 <= last <= recorded:
        raise ValueError(
            f"Of {recorded} forcing periods the last {last} are to be compared with each other, but they must "
            f"be 2 at least and {recorded} at most: record more periods, or change `last`."
        )
    own = {"x": "mass", "v": "mass", "held_time": "stop"}
    columns = {name: flattened_points(source, section[name], "period", dim) for name, dim in own.items()}
    return xr.Dataset({name: (("point", "period", own[name]), a) for name, a in columns.items()}), last


def _motion(
    n: np.ndarray, is_failed: np.ndarray, is_settling: np.ndarray, tally: _PeriodCounts, is_cut: np.ndarray
) -> np.ndarray:
    """Index in `MOTIONS` of each motion; where the log is cut, a held mass counts as chatter."""
    is_held = (tally.held_time > 0).any(axis=1)
    is_chattering = np.isinf(tally.num_impacts).any(axis=1) | (is_cut & is_held)
    is_impacting = (tally.num_impacts > 0).any(axis=1) | is_cut
    kinds = {
        "failed": is_failed,
        "not_settled": (n == 0) & is_settling,
        "non_periodic": n == 0,
        "chattering": is_chattering,
        "periodic": is_impacting,
    }
    numbers = [MOTIONS.index(kind) for kind in kinds]
    return np.select([*kinds.values()], numbers, MOTIONS.index("non_impacting")).astype(np.int8)


def _on_one_side(
    source: Solution | xr.Dataset,
    section: xr.Dataset,
    masses: np.ndarray,
    impacts: Impacts,
    number: np.ndarray,
    in_periods: np.ndarray,
) -> np.ndarray:
    """Velocities with the impacts just before the end of a period undone; those with friction just after it done instead.

    Rounding puts an impact at the very end of a period before it or after it, which reverses the velocity. Friction that
    stops within an impact forgets its velocity, so that the impact cannot be undone.
    """
    v = section.v.values
    # Impacts just after the end are included, since times are rounded; undoing those changes nothing.
    is_undone = (number >= 1) & (number <= v.shape[1]) & (in_periods <= number + 1e-9)
    is_tied = is_undone.any() and has_tied_friction(source)
    if is_tied:
        is_undone &= in_periods >= number - 1e-9
    # Of several impacts of one state the first counts, so it is undone last.
    which = np.flatnonzero(is_undone)[::-1]
    v = v.copy()
    is_own = masses[impacts.stop[which]] >= 0
    if which.size and (is_tied or has_full_mass(source)):
        is_own = np.zeros_like(is_own)
    own, others = which[is_own], which[~is_own]
    v[impacts.point[own], number[own] - 1, masses[impacts.stop[own]]] = impacts.velocity[own]
    while others.size:
        # One impact of each state at a time.
        _, chosen = np.unique(impacts.point[others] * v.shape[1] + number[others], return_index=True)
        _moved_across(source, (section.x.values, v), impacts, number, others[chosen])
        others = np.delete(others, chosen)
    return v


def _moved_across(
    source: Solution | xr.Dataset,
    states: tuple[np.ndarray, np.ndarray],
    impacts: Impacts,
    number: np.ndarray,
    which: np.ndarray,
) -> None:
    """Undo, in place, impacts by which several masses change their velocities, if the machines are stored.

    Those with friction are done where the states are before them.
    """
    which, (x, v) = padded_to_power_of_two(which), states
    machine, angle = machines(source, impacts.point[which])
    if machine is None:
        return
    place, stop = (impacts.point[which], number[which] - 1), impacts.stop[which]
    if machine.has_tied_friction:
        is_hit = np.arange(machine.contacts.num)[:, None] == stop
        v[place] = after_impacts(machine, angle, (x[place], v[place]), is_hit)[1]
    else:
        v[place] = before_impact(machine, angle, v[place], stop, impacts.velocity[which])


def _relative(x: np.ndarray, v: np.ndarray, frequency: np.ndarray, impacts: Impacts) -> np.ndarray:
    """States relative to the size of the motion: the largest velocity, or W x if that is larger."""
    x = frequency[:, None, None] * x
    size = np.maximum(*(np.abs(a).max(axis=(1, 2), initial=0) for a in (x, v)))
    np.fmax.at(size, impacts.point, np.abs(impacts.velocity))
    return np.concatenate([x, v], axis=2) / np.where(size == 0, 1, size)[:, None, None]


def _is_touched(section: xr.Dataset, impacts: Impacts, number: np.ndarray, last: int) -> np.ndarray:
    """True where an impact or a held mass occurs in the periods that are compared."""
    is_late = number >= section.sizes["period"] - last
    num_impacts = np.bincount(impacts.point[is_late], minlength=section.sizes["point"])
    return (num_impacts > 0) | (section.held_time.values[:, -last:] > 0).any(axis=(1, 2))


def _with_proved_non_impacting(
    source: Solution | xr.Dataset,
    found: Recurrence,
    section: xr.Dataset,
    wanted: np.ndarray,
    relative: np.ndarray,
) -> Recurrence:
    """Classify motions without impacts by the response of their machine: in the section, beats hide how they end."""
    is_quiet, contraction = prove_non_impacting(
        source, wanted, *(section[name].values[:, -1] for name in ("x", "v"))
    )
    step = np.abs(relative[:, -1] - relative[:, -2]).max(axis=1)
    return Recurrence(
        np.where(is_quiet, 1, found.num_periods),
        np.where(is_quiet, step, found.error),
        np.where(is_quiet, contraction, found.contraction),
        found.is_settling & ~is_quiet,
    )


def _with_exponents(source: Solution | xr.Dataset, found: Recurrence) -> Recurrence:
    """Classify motions that do not repeat by their largest Lyapunov exponent, where it differs clearly from zero."""
    if isinstance(source, Solution) or "lyapunov_exponents" not in source:
        return found
    check_columns(
        source, "`vx.sweep`", dict.fromkeys(("lyapunov_exponents", "lyapunov_error"), ("exponent",))
    )
    largest, error = (
        flattened_points(source, source[f"lyapunov_{name}"], "exponent")[:, 0]
        for name in ("exponents", "error")
    )
    is_settling = np.where(largest > 3 * error, False, found.is_settling | (largest < -3 * error))
    return found._replace(is_settling=is_settling)


def _is_cut(source: Solution | xr.Dataset, impacts: Impacts, num_points: int) -> np.ndarray:
    """True where the log of a sweep ends early; the states of a trajectory are NaN after its log ends."""
    if isinstance(source, Solution):
        return np.zeros(num_points, bool)
    check_columns(source, "`vx.sweep`", {"num_impacts": ("stop",)})
    happened = flattened_points(source, source["num_impacts"], "stop").sum(axis=1)
    return np.bincount(impacts.point, minlength=num_points) < happened


def _tally(
    section: xr.Dataset, impacts: Impacts, number: np.ndarray, n: np.ndarray, masses: np.ndarray
) -> _PeriodCounts:
    """Count impacts and held times in the last n periods of each point."""
    recorded, shape = section.sizes["period"], (len(n), len(masses))
    is_ours = (number >= (recorded - n)[impacts.point]) & (number < recorded)
    place = impacts.point * len(masses) + impacts.stop
    count = lambda which: np.bincount(place[which], minlength=math.prod(shape)).reshape(shape)  # noqa: E731
    counts = np.where(count(is_ours & impacts.sticks) > 0, np.inf, count(is_ours))
    is_last = np.arange(recorded) >= (recorded - n)[:, None]
    return _PeriodCounts(
        is_ours, counts, np.where(is_last[..., None], section.held_time.values, 0).sum(axis=1)
    )


def _double_impacts(
    impacts: Impacts, is_ours: np.ndarray, masses: np.ndarray, within: np.ndarray
) -> np.ndarray:
    """Count neighbouring impacts of two masses, or contacts, within `within`, in the period of the second impact."""
    first, second = slice(None, -1), slice(1, None)
    # A contact between masses has no mass of its own, and counts as another mass.
    of_stop = np.where(masses >= 0, masses, -1 - np.arange(len(masses)))
    point, mass = impacts.point, of_stop[impacts.stop]
    is_double = (point[first] == point[second]) & (mass[first] != mass[second]) & is_ours[second]
    is_double &= np.diff(impacts.time) <= within[point[second]]
    return np.bincount(point[second][is_double], minlength=len(within)).astype(float)
