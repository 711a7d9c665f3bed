"""Parameter value of a bifurcation as a differentiable function of the machine."""

from collections.abc import Callable
from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Int

from .._flow.taylor import TaylorFlow
from .._jax.arrays import Scalar, check_type, refuse_single_precision
from .._jax.concrete import concrete_evaluation, stop_gradients
from .._jax.errors import checked
from .._jax.nan_mask import known_or_nan
from .._jax.xla import compile_quickly, differentiable, padding_allowed
from .._orbits.cycle import traverse
from .._system.parameters import is_parameter
from .._system.system import AnySystem, varied
from .admissibility import margins_of_cycle
from .bifurcation_setup import defining_system_of
from .branch import Bifurcation, Peak
from .defining_systems import AbstractCondition, DefiningSystem, implicit_solution, solve
from .parameter_family import ExtendedCycle
from .peak_condition import height_of
from .tolerances import ROUNDED_BY_TYPE

_SENTENCES = (
    "",
    "Newton's method came to no such bifurcation: change the numbers of the machine by less, or follow a branch of it "
    "by `vx.continuation`.",
    "The machine does not follow the orbit that has this bifurcation, which passes through a stop or is held where it is "
    "pulled: follow a branch of the machine by `vx.continuation`.",
)


@padding_allowed
def bifurcation_value(point: Bifurcation, system: AnySystem, *, throw: bool = True) -> Scalar:
    """Return the value of the parameter at which a machine has a bifurcation, as a differentiable function.

    Newton's method solves the defining system for a machine close to that of the point: the equations of the orbit,
    with the parameter as an unknown, and the condition of the bifurcation, such as a multiplier of -1 or an impact
    without speed. Nothing is divided by the speed of an impact.

    Works under `jax.jit` and `jax.vmap`. Forward and reverse derivatives by all numbers of the machine follow from the
    implicit function theorem. With a `force` the value is as accurate as the `flow` of the point's orbit, and
    compilation takes a minute.

    Args:
        point: one of `branch.bifurcations`, of kind "fold", "pd", "ns", "bp", "pitchfork", "gr", "double_impact" or "force_zero";
            or one of `branch.peaks`.
        system: the machine, with as many masses, the same stops, and a `force` if that of the point has one; its own
            value of the branch's parameter is not used. At a "bp" or "pitchfork" it has the symmetry of the orbits that cross.
        throw: raise if the bifurcation is not found; otherwise its value is NaN, and so are its derivatives by all
            that it depends on.

    Returns:
        The value, in the units of the parameter.

    Raises:
        ValueError: for a point of another kind, a machine of another structure, or if 64-bit numbers are off.
        RuntimeError: with `throw`, if Newton's method finds none near, or one that no motion of the machine has.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
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
    return _of_machine_at(point, system, _value, "bifurcation_value", throw=throw)


@padding_allowed
def peak_height(point: Bifurcation, system: AnySystem, *, throw: bool = True) -> Scalar:
    """Return the height of a peak of a machine, as a differentiable function.

    As `vx.bifurcation_value`, which gives the parameter at the peak: the peak is found anew for each machine. To make a
    resonance least, descend along this function's gradient.

    Args:
        point: one of `branch.peaks`.
        system: as for `vx.bifurcation_value`.
        throw: likewise.

    Returns:
        The quantity at the peak, in its units.

    Raises:
        ValueError: as `vx.bifurcation_value`, or for a point that is no peak.
        RuntimeError: with `throw`, if Newton's method finds no peak near, or one that no motion of the machine has.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        machine = lambda c: vx.ImpactSystem([1.0], [[c]], [[1.0]], vx.Harmonic([1.0], 0.7), [])
        orbit = vx.periodic_orbit(machine(0.1), [0.0], [0.0])
        peak = vx.continuation(orbit, "forcing.frequency", (0.5, 1.5), peaks=["max_position"]).peaks[0]
        jax.grad(lambda c: vx.peak_height(peak, machine(c)))(0.1)
        ```

    References:
        J. P. Den Hartog, Mechanical Vibrations (4th ed., 1956), Sec. 3.3.
    """
    if not isinstance(point, Peak):
        raise ValueError(f"Argument `point` must be one of `branch.peaks`, but is {point!r}.")
    return _of_machine_at(point, system, _height, "peak_height", throw=throw)


def _of_machine_at(
    point: Bifurcation, system: AnySystem, read: Callable, function: str, *, throw: bool
) -> Scalar:
    """Number read of a defining system, solved for a machine."""
    check_type("point", point, Bifurcation, "one of `branch.bifurcations` or `branch.peaks`")
    refuse_single_precision(function, point.branch.points["x0"], system)
    with concrete_evaluation():
        values = point.branch.values
        defining, guess = defining_system_of(point, float(values.min()), float(values.max()))
    defining = _of_machine(defining, varied(system, None))
    condition, y, number = _solved(stop_gradients(defining), guess)
    solved = replace(defining, condition=condition), y
    # JAX cannot transpose its derivative of an ODE solver; exact flows compile faster without `differentiable`.
    found = read(solved) if system.force is None else differentiable(read, solved)
    return checked(found, number, _SENTENCES) if throw else known_or_nan(number == 0, found)


def _of_machine(defining: DefiningSystem, system: AnySystem) -> DefiningSystem:
    """Defining system with the machine replaced."""
    make = lambda system: (system.num_masses, [stop.slot or (*stop.coefficients,) for stop in system.stops])  # noqa: E731
    (masses, stops), ours = make(defining.family.system), make(system)
    has_force, ours_has = (one.force is not None for one in (defining.family.system, system))
    if ours != (masses, stops) or ours_has != has_force:
        raise ValueError(
            f"Argument `system` must be a machine like that of the point, with {masses} masses, "
            f"{'a' if has_force else 'no'} `force` and stops at (mass, side) = {stops}."
        )
    if not is_parameter(system, defining.family.path):
        raise ValueError(
            f"Argument `system` must have the parameter `{defining.family.path}` of the branch: for a point on a branch of a family "
            "give a family, as family.at(...), else a machine."
        )
    # The same exact flow for concrete and for traced matrices: one program.
    flow = defining.family.flow if has_force else TaylorFlow()
    return replace(defining, family=replace(defining.family, system=system, flow=flow))


def _value(solved: tuple[DefiningSystem, Array]) -> Scalar:
    """Parameter value of a solved defining system."""
    defining, y = solved
    return defining.place(implicit_solution(defining, y))[0].p * defining.family.span


def _height(solved: tuple[DefiningSystem, Array]) -> Scalar:
    """Height of the peak of a solved defining system."""
    defining, y = solved
    return height_of(defining, implicit_solution(defining, y))


@compile_quickly
def _solved(
    defining: DefiningSystem, guess: ExtendedCycle
) -> tuple[AbstractCondition, Array, Int[Array, ""]]:
    """Condition, unknowns that satisfy it, and index of the error sentence, 0 on success."""
    solved = solve(defining, defining.unknowns(guess))
    place, own = defining.place(solved.y)
    is_motion = _is_admissible(defining, place)
    # Without the symmetry the branches part, and the unfolding is not zero.
    parts = jnp.max(jnp.abs(solved.defining.condition.unfolding(own)))
    is_found = solved.is_found & (parts < ROUNDED_BY_TYPE[str(solved.y.dtype)])
    return solved.defining.condition, solved.y, jnp.where(is_found, jnp.where(is_motion, 0, 2), 1)


def _is_admissible(defining: DefiningSystem, place: ExtendedCycle) -> Array:
    """True if no stop is penetrated, no held mass is pulled, and the events are in order."""
    family, sequence = defining.family, defining.sequence
    problem, unknowns = family.problem(sequence, place.p), family.unknowns(place)
    begins, speeds = traverse(problem, unknowns, jnp.sum(sequence.is_event))
    watched = margins_of_cycle(problem, unknowns, begins)
    length, speed = family.scale[0], family.scale[-1]
    force = speed * problem.machine.frequency * jnp.max(family.system.mass)
    least = [
        jnp.min(watched.gap, initial=jnp.inf) / length,
        jnp.min(watched.force, initial=jnp.inf) / force,
        jnp.min(speeds, initial=jnp.inf) / speed,
        jnp.min(place.flights[1:], initial=jnp.inf),
    ]
    return jnp.min(jnp.stack(least)) > -ROUNDED_BY_TYPE[str(length.dtype)]
