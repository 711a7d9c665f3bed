"""Where a bifurcation is, as a function of the machine."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .._flow.taylor import TaylorFlow
from .._orbits.cycle import residual
from .._orbits.sequence import Sequence
from .._refusal import checked
from .._system.system import ImpactSystem, with_args
from .._trajectory.ending import known_or_nan
from .._trajectory.event_log import IMPACT, RELEASE
from .._types import Scalar, constant, known_stays_known
from .._xla import compile_lightly, padding_allowed
from .branch import Bifurcation, cycle_of
from .changes import with_event
from .curve import as_it_is, test_of
from .defining import AbstractCondition, AtEvent, AtMultiplier, Defining, implicit, solve
from .family import Family, Place
from .follow import CLOSE
from .programs import drive, padded, room_for
from .starts import family_of, starts_of
from .watch import watch

# What must not be negative on a motion is zero but for rounding.
_ROUNDING = {"float64": 1e-9, "float32": 1e-4}
_SENTENCES = (
    "",
    "Newton's method came to no such bifurcation: change the numbers of the machine by less, or follow a branch of it "
    "by `vx.continuation`.",
    "The machine does not follow the orbit that has this bifurcation, which passes through a stop or is held where it is "
    "pulled: follow a branch of the machine by `vx.continuation`.",
)
_NOT_DERIVED = {
    "bp": "A branch point is there for one machine alone, or by a symmetry: take the points of a branch beside it.",
    "chatter_completion": 'Where a chatter is completed infinitely many changes meet: take one of them, of a kind "gr" '
    'or "fold".',
}


@padding_allowed
def bifurcation_value(point: Bifurcation, system: ImpactSystem, *, throw: bool = True) -> Scalar:
    """Return the value of the parameter at which a machine has a bifurcation, as a differentiable function.

    For a machine close to that of the point, by Newton's method on its defining system: the equations of the orbit, with
    the parameter as an unknown, and those of what happens there, as a multiplier of -1, or an impact without speed.
    Nothing is divided by the speed of an impact.

    Works under `jax.jit` and `jax.vmap`. Derivatives by all numbers of the machine, forward and reverse, are those of the
    implicit function theorem.

    Args:
        point: one of `branch.bifurcations`, of the kind "fold", "pd", "ns", "gr", "double_impact" or "force_zero".
        system: the machine, with as many masses and the same stops; whatever it has for the parameter of the branch is
            not used.
        throw: raise if the bifurcation is not found; otherwise its value is NaN, and so are derivatives by what it depends on.

    Returns:
        The value, in the units of the parameter.

    Raises:
        ValueError: for a point of another kind, or a machine of another make.
        RuntimeError: with `throw`, if Newton's method finds none near, or one that no motion of the machine has.

    Example:
        ```python
        import jax, vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
        fold = vx.continuation(orbit, "forcing.frequency", (0.8, 1.0)).bifurcations[1]
        frequency = lambda amplitude: vx.bifurcation_value(fold, vx.models.wagg_bishop_a(0.8, amplitude))
        jax.grad(frequency)(0.3)
        ```

    References:
        Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sec. 10.3; W. Govaerts, Numerical Methods for
        Bifurcations of Dynamical Equilibria (2000), Ch. 3.
    """
    if point.kind in _NOT_DERIVED:
        raise ValueError(_NOT_DERIVED[point.kind])
    with known_stays_known():
        defining, guess = _known(point)
    defining = _of_machine(defining, with_args(system, None))
    solved, y, number = _solved(constant(defining), guess)
    place, _ = defining.place(implicit(replace(defining, condition=solved), y))
    found = place.p * defining.family.span
    return checked(found, number, _SENTENCES) if throw else known_or_nan(number == 0, found)


def _of_machine(defining: Defining, system: ImpactSystem) -> Defining:
    """The defining system of another machine."""
    make = lambda system: (system.num_masses, [stop.slot or (*stop.coefficients,) for stop in system.stops])  # noqa: E731
    (masses, stops), ours = make(defining.family.system), make(system)
    if ours != (masses, stops) or system.force is not None:
        raise ValueError(
            f"Argument `system` must be a machine like that of the point, with {masses} masses, no `force` and stops at "
            f"(mass, side) = {stops}."
        )
    # One motion whether matrices are known or traced: one program.
    return replace(defining, family=replace(defining.family, system=system, flow=TaylorFlow()))


def _known(point: Bifurcation) -> tuple[Defining, Place]:
    """The defining system of a point, with padding, and its cycle."""
    (start,) = starts_of(point.orbit)
    values = point.branch.values
    family = family_of(
        start._replace(is_admissible=True), point.branch.path, float(values.min()), float(values.max())
    )
    sequence, place = cycle_of(point, family.scale, point.value / float(family.span))
    if point.kind in ("fold", "pd", "ns"):
        condition = _at_multiplier(point)
    else:
        condition, sequence, place = _at_event(family, point.kind, sequence, place)
    sequence, place = padded(sequence, (place,), room_for(len(sequence.kind)))
    return Defining(family, sequence, condition), place


def _at_multiplier(point: Bifurcation) -> AbstractCondition:
    multipliers = point.branch.points["multipliers"].values[point.index]
    away = np.abs(multipliers + 1) if point.kind == "pd" else np.abs(np.abs(multipliers) - 1)
    if point.kind == "pd" and not away.min() < CLOSE:
        raise ValueError(
            "The orbit of this point is another one twice: take the period doubling on the branch of that one."
        )
    # Of a pair the one above the real axis.
    angle = np.angle(multipliers[np.argmin(np.where(multipliers.imag > 0, away, np.inf))])
    theta = {"fold": 0.0, "pd": np.pi}.get(point.kind, angle)
    return AtMultiplier(np.array([theta]), np.zeros((2, len(multipliers)), complex))


def _at_event(
    family: Family, kind: str, sequence: Sequence, place: Place
) -> tuple[AbstractCondition, Sequence, Place]:
    (seen,) = drive([family], [as_it_is(sequence, place)], lambda: None)
    test, watched = test_of(kind, sequence, seen), seen.watched
    k, is_tangent = test.index, test.kind != "double_impact"
    if test.kind == "touch":
        flight, time = int(watched.gap_flight[k]), float(watched.gap_time[k])
        sequence, place = with_event(sequence, place, IMPACT, k, flight, time)
        k = flight
    if test.kind == "force_zero":
        flight, time = int(watched.force_flight[k]), float(watched.force_time[k])
        sequence, place = with_event(sequence, place, RELEASE, k, flight, time)
        k, is_tangent = flight, bool(place.flights[flight] > _ROUNDING[str(place.flights.dtype)])
    return AtEvent(np.zeros(0), np.asarray(k), np.asarray(is_tangent)), sequence, place


@compile_lightly
def _solved(defining: Defining, guess: Place) -> tuple[AbstractCondition, Array, Int[Array, ""]]:
    """The condition, the unknowns that satisfy it, and the number of a sentence, 0 if all is well."""
    defining, y, is_found = solve(defining, guess)
    is_motion = _is_motion(defining, defining.place(y)[0])
    return defining.condition, y, jnp.where(is_found, jnp.where(is_motion, 0, 2), 1)


def _is_motion(defining: Defining, place: Place) -> Array:
    """Whether no stop is passed, no mass held where it is pulled, and the events are in their order."""
    family, sequence = defining.family, defining.sequence
    problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
    watched, speeds = watch(problem, unknowns), residual(problem, unknowns).speed
    length, speed = family.scale[0], family.scale[-1]
    force = speed * problem.machine.frequency * jnp.max(family.system.mass)
    least = [
        jnp.min(watched.gap, initial=jnp.inf) / length,
        jnp.min(watched.force, initial=jnp.inf) / force,
        jnp.min(speeds, initial=jnp.inf) / speed,
        jnp.min(place.flights[1:], initial=jnp.inf),
    ]
    return jnp.min(jnp.stack(least)) > -_ROUNDING[str(length.dtype)]
