"""Conditions on the values of a machine and of a start, each with its error message, written once.

The same conditions hold for one machine, checked when it is built, and for many machines with lanes last, checked
before they are swept. Their messages differ: the one for a single machine quotes the wrong value, the one for a batch
says only that some value is wrong. Traced values pass unchecked, but traced conditions on a start are returned, for
the program to raise.

Stops and machines are `Any` here, since the files that define them import this one. Rejected alternative: checks in
each class. No class builds the lanes of a sweep, so all conditions were needed a second time.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._jax.arrays import Flag, Reals, array_namespace
from .._jax.concrete import concrete
from .painleve import check_slip


class Rule(NamedTuple):
    """A condition on numbers.

    Attributes:
        holds: True for each number that satisfies the condition.
        one: end of the message about a single argument, as in "must be finite"; empty for batches only.
        every: message about a batch, with a placeholder `{name}` for the path; empty for single arguments only.
    """

    holds: Callable[[np.ndarray], Any]
    one: str = ""
    every: str = ""


FINITE = Rule(np.isfinite, "be finite", "All swept values must be finite.")
POSITIVE = Rule(
    lambda a: np.isfinite(a) & (a > 0), "be positive and finite", "Every swept `{name}` must be positive."
)
NOT_NEGATIVE = Rule(
    lambda a: np.isfinite(a) & (a >= 0),
    "be finite and not negative",
    "Every `{name}` must be finite and not negative.",
)
# A load of frequency 0 is constant and has no period.
HAS_PERIOD = Rule(
    lambda a: a > 0,
    every="Every `{name}` must be positive: a sweep counts forcing periods, unless it has a `duration`.",
)
RISING = Rule(lambda a: np.diff(a, axis=0) > 0, every="Every swept `{name}` must rise from knot to knot.")
RESTITUTION = Rule(
    lambda a: (a >= 0) & (a <= 1),
    "lie between 0 (plastic) and 1 (elastic)",
    "Every `{name}` must lie between 0 and 1.",
)


def check_one(name: str, value: Array, rule: Rule) -> None:
    """Reject an argument that violates a rule, unless it is traced."""
    known = concrete(value)
    if known is not None and not rule.holds(known).all():
        raise ValueError(f"Argument `{name}` must {rule.one}, but is {' '.join(str(known).split())}.")


def check_number(name: str, value: Array, rule: Rule) -> None:
    """Reject an argument that is not one number, or violates a rule."""
    if value.ndim:
        raise ValueError(f"Argument `{name}` must be a number, but has shape {value.shape}.")
    check_one(name, value, rule)


def check_shape(name: str, value: Array | np.ndarray, shape: tuple[int, ...]) -> None:
    """Reject an argument of another shape."""
    if value.shape != shape:
        raise ValueError(f"Argument `{name}` must have shape {shape}, but has shape {value.shape}.")


def whole_start(system: Any, x0: Reals, v0: Reals) -> tuple[Reals, Reals]:
    """Start of all coordinates of one trajectory, (coordinates,) each, from that of the masses or of all; refuses other shapes."""
    x, v = system.start_of(x0, v0)
    for name, value in (("x0", x), ("v0", v)):
        check_shape(name, value, (system.num_coordinates,))
    return x, v


def check_every(name: str, values: Array | np.ndarray, rule: Rule) -> None:
    """Reject values of many machines if one of them violates a rule."""
    if not rule.holds(np.asarray(values)).all():
        raise ValueError(rule.every.format(name=name))


def check_finite(name: str, matrices: np.ndarray) -> None:
    """Reject matrices, (..., n, n), with entries that are not finite."""
    if not np.isfinite(matrices).all():
        raise ValueError(f"Argument `{name}` must be finite, but is {matrices.tolist()}.")


def is_symmetric(matrices: np.ndarray) -> np.ndarray | np.bool_:
    """True for matrices, (..., n, n), symmetric to 4 n eps max|a_ij|."""
    return _skew(matrices) <= _slack(matrices)


def is_semidefinite(matrices: np.ndarray) -> np.ndarray | np.bool_:
    """True for symmetric matrices, (..., n, n), without eigenvalues below zero by more than rounding."""
    symmetric = np.where(np.isfinite(matrices), matrices, 0)
    lowest = np.linalg.eigvalsh((symmetric + np.swapaxes(symmetric, -2, -1)) / 2)[..., 0]
    return is_symmetric(matrices) & (lowest >= -_slack(matrices) * matrices.shape[-1])


def _skew(matrices: np.ndarray) -> np.ndarray | np.floating:
    return np.abs(matrices - np.swapaxes(matrices, -2, -1)).max(axis=(-2, -1))


def _slack(matrices: np.ndarray) -> np.ndarray | np.floating:
    norm = np.abs(matrices).max(axis=(-2, -1), initial=0.0)
    with np.errstate(over="ignore"):
        is_narrow = (matrices == matrices.astype(np.float32)).all()
    # Numbers that were once in single precision carry its rounding, whatever their type now.
    eps = np.finfo(np.float32 if is_narrow else matrices.dtype).eps
    return 4 * matrices.shape[-1] * eps * norm


def check_mass_matrices(matrices: np.ndarray) -> None:
    """Reject matrices, (..., n, n), not symmetric or not positive definite beyond rounding."""
    check_finite("mass", matrices)
    if not is_symmetric(matrices).all():
        raise ValueError(
            f"Argument `mass` must be symmetric, but differs from its transpose by {_skew(matrices).max():.3g}; "
            "use (mass + mass.T) / 2 if that is rounding."
        )
    values = np.linalg.eigvalsh(matrices)
    if (values[..., 0] <= 4 * values.shape[-1] * np.finfo(values.dtype).eps * values[..., -1]).any():
        raise ValueError(
            f"Argument `mass` must be positive definite, but has the eigenvalue {values[..., 0].min():.3g}: "
            "a coordinate without inertia has no equation of motion."
        )


def check_slots(stops: Sequence[Any]) -> None:
    """Reject two stops of one mass whose mean positions leave no room between them; lanes may be last."""
    for lower, upper in _slots(stops):
        low, high = concrete(lower.centre), concrete(upper.centre)
        if low is None or high is None or (low < high).all():
            continue
        is_one = low.ndim == high.ndim == 0
        at_low, at_high, where = (
            (f" (at {low})", f" (at {high})", "") if is_one else ("", "", " at every point")
        )
        raise ValueError(
            f"The lower stop of mass {lower.mass}{at_low} must lie below its upper stop{at_high}{where}."
        )


def check_room(stops: Sequence[Any]) -> None:
    """Reject two contacts that act against each other and leave no room between them; lanes may be last."""
    for (i, one), (j, other) in combinations(enumerate(stops), 2):
        is_slot = one.slot is not None and other.slot is not None
        if is_slot or one.is_compliant or other.is_compliant or _masses(one) != _masses(other):
            continue
        share = _against(one.coefficients, other.coefficients)
        places = concrete(one.centre), concrete(other.centre)
        if share is None or any(place is None for place in places):
            continue
        if not (one.sign * places[0] + share * other.sign * places[1] > 0).all():
            raise ValueError(
                f"Contacts {i} and {j} act against each other and leave no room between them: join the masses, or move one of the "
                "contacts away."
            )


def _masses(stop: Any) -> set[int]:
    return {stop.slot[0]} if stop.slot is not None else set(stop.masses)


def _against(one: dict[int, Reals], other: dict[int, Reals]) -> Reals | None:
    """Positive factor by which a row is the opposite of one of the same masses; None if it is not, or not known to be."""
    pairs = [(concrete(one[mass]), concrete(other[mass])) for mass in sorted(one)]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    if len(known) < len(pairs):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -known[0][0] / known[0][1]
        are_opposite = [np.isclose(a, -share * b, rtol=1e-12, atol=0) for a, b in known]
    return share if (share > 0).all() and np.all(are_opposite) else None


def check_machines(system: Any, x0: Array | np.ndarray, *, counts_periods: bool = True) -> None:
    """Reject invalid values of machines or of their starts, all lanes at once; lanes last.

    `counts_periods` is true where the load must have a period.
    """
    if system.has_full_mass:
        check_mass_matrices(np.moveaxis(np.asarray(system.mass), -1, 0))
    else:
        check_every("mass", system.mass, POSITIVE)
    if counts_periods and system.forcing.why_not_periodic:
        raise ValueError(system.forcing.why_not_periodic)
    check_every("forcing.frequency", system.forcing.frequency, HAS_PERIOD if counts_periods else NOT_NEGATIVE)
    for load in system.forcing.loads:
        load.check_lanes(check_every)
    for name in ("damping", "stiffness"):
        check_finite(name, np.asarray(getattr(system, name)))
    for j, stop in enumerate(system.stops):
        stop.check_law(f"stops[{j}].", check_every)
    for name in ("friction", "hysteresis"):
        for k, element in enumerate(getattr(system, name)):
            element.check_law(f"{name}[{k}].", check_every)
    refuse(_beyond(system.stops, x0, 0.0, "Some points start"))
    check_slots(system.stops)
    check_room(system.stops)
    check_slip(system)


def validate_start(
    system: Any,
    t0: Reals,
    t1: Reals,
    ts: Reals,
    x0: Reals,
    v0: Reals,
) -> list[tuple[Flag, str]]:
    """Reject an invalid start, and return the conditions that are traced; times (times,), the start (n,)."""
    checks = not_finite({"t0": t0, "t1": t1, "x0": x0, "v0": v0})
    checks.append((t1 < t0, "Argument `t1` must not lie before `t0`."))
    if ts.size:
        in_order = (ts[1:] >= ts[:-1]).all() & (ts[0] >= t0) & (ts[-1] <= t1)
        checks.append((~in_order, "Argument `ts` must be in increasing order, within [t0, t1]."))
    # The rounding error scales with the motion; the position of a stop at 0, where it may end, gives no scale.
    angle = system.forcing.frequency * t0
    travel = _travel_within_a_radian(system, v0) + abs(x0).max()
    travel = travel + sum(stop.reach(angle) for stop in system.stops if not stop.is_compliant)
    checks += _beyond(system.stops, x0, angle, "The start lies", 8 * travel)
    return refuse(checks)


def _travel_within_a_radian(system: Any, v: Reals) -> Reals:
    """Size of displacements by velocities; and by load and friction, which masses at rest withstand, if all are known."""
    forcing = system.forcing
    frequency = forcing.frequency + (forcing.frequency <= 0)
    moved = abs(v).max() / frequency
    constant = [element for element in system.friction if not element.is_tied]
    rows = [(element.grip, i, a) for element in constant for i, a in element.coefficients.items()]
    numbers = forcing.frequency, system.mass, system.stiffness
    known = [a for a in map(concrete, (*numbers, *(grip * a for grip, _, a in rows))) if a is not None]
    of_load, structure = jax.tree.flatten(forcing)
    known_load = [a for a in map(concrete, of_load) if a is not None]
    if len(known) < len(numbers) + len(rows) or len(known_load) < len(of_load):
        return moved
    rate, mass, stiffness, *pulls = known
    inertia = mass.diagonal() if system.has_full_mass else mass
    resistance = inertia * (rate + (rate <= 0)) ** 2 + abs(stiffness.diagonal())
    force = jax.tree.unflatten(structure, known_load).size()
    friction = sum(abs(pull / resistance[i]) for pull, (_, i, _) in zip(pulls, rows, strict=True))
    return moved + (force / resistance).max() + friction


def refuse(checks: list[tuple[Any, str]]) -> list[tuple[Any, str]]:
    """Raise the message of the first concrete condition that fails; return the traced conditions.

    Args:
        checks: pairs of a condition, true where something is wrong, and its message.
    """
    verdicts = [concrete(is_wrong) for is_wrong, _ in checks]
    for verdict, (_, sentence) in zip(verdicts, checks, strict=True):
        if verdict is not None and verdict.any():
            raise ValueError(sentence)
    return [check for verdict, check in zip(verdicts, checks, strict=True) if verdict is None]


def not_finite(named: dict[str, Reals]) -> list[tuple[Any, str]]:
    """Conditions for `refuse`, one for each named argument, true where it is not finite."""
    return [
        (~array_namespace(a).isfinite(a).all(), f"Argument `{name}` must be finite.")
        for name, a in named.items()
    ]


def is_touching(gap: Reals, size: Reals) -> Reals:
    """Test whether a gap is zero up to rounding, given the magnitude of the terms subtracted."""
    return abs(gap) <= 8 * jnp.finfo(gap.dtype).eps * abs(size)


def is_past(stop: Any, x: Any, angle: Any, travel: Any = 0.0) -> Any:
    """Test whether x lies beyond a stop, by more than rounding, at the phase `angle` of the load; lanes may be last.

    `travel` is the size of displacements that led to x. Those whose squares underflow give no scale: events of such motions are
    not found to their last digit.
    """
    gap, size = stop.gap(x, angle), stop.reach(angle) + (0 if stop.slot else stop.size(x))
    return (gap < -(float(jnp.finfo(gap.dtype).tiny) ** 0.5)) & ~is_touching(gap, size + travel)


def _beyond(stops: Sequence[Any], x: Any, angle: Any, who: str, travel: Any = 0.0) -> list[tuple[Any, str]]:
    """Conditions for `refuse`, true where x lies beyond a stop at the phase `angle` of the load, see `is_past`."""
    return [
        (is_past(stop, x, angle, travel), f"{who} beyond a stop: {stop.remedy.format(j=j)}")
        for j, stop in enumerate(stops)
        if not stop.is_compliant
    ]


def move_alike(stops: Sequence[Any]) -> bool:
    """True if the two stops of every mass that has two have equal motions, and concrete ones; lanes may be last."""
    # Fixed stops are skipped: under a trace even their comparison could stay undecided.
    moving = [(a, b) for a, b in _slots(stops) if a.motion is not None or b.motion is not None]
    verdicts = [concrete(a.moves_like(b)) for a, b in moving]
    return all(verdict is not None and verdict.all() for verdict in verdicts)


def _slots(stops: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Pairs of the lower and the upper stop of every mass that has both."""
    places = {stop.slot: stop for stop in stops if stop.slot is not None and not stop.is_compliant}
    for (mass, side), stop in places.items():
        if side == "lower" and (mass, "upper") in places:
            yield stop, places[mass, "upper"]
