"""Maps of the motion onto itself, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._contact.law import rebound
from .._flow.interface import AbstractFlow
from .._machine.machine import prepare, resting_state
from .._machine.numbers import numbers_of
from .._system.periodicity import refuse_off_period
from .._system.system import ImpactSystem, with_args
from .._trajectory.simulate import Settings, follow
from .._trajectory.solution import RESULTS
from .._types import Count, Numbers, as_float, concrete, in_full_precision, whole_number
from .._xla import padding_allowed


@padding_allowed
def stroboscopic_map(
    system: ImpactSystem,
    x0: Numbers,
    v0: Numbers,
    num_periods: Count = 1,
    *,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_steps: Count | None = None,
    max_reverse_steps: Count = 65_536,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return the state some forcing periods later, as a differentiable function.

    Starts at phase 0. Derivatives by state and parameters include those of the period.

    Args:
        system: the machine; its load must have a frequency, and its `force`, if it has one, that period.
        x0: positions, (n,).
        v0: velocities, (n,).
        num_periods: whole forcing periods.
        flow: as for `simulate`.
        args: likewise.
        max_steps: as for `simulate`.
        max_reverse_steps: likewise.

    Returns:
        Positions and velocities, (n,) each.

    Raises:
        ValueError: if the load has no frequency, or the `force` not the period of the load, as far as can
            be told while its numbers are not traced.
        RuntimeError: if the motion does not get there, see `RESULTS`.

    Example:
        ```python
        import jax, vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        jacobian = jax.jacfwd(lambda x: vx.stroboscopic_map(system, x, [0.0, 0.0]))
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2.
    """
    system = in_full_precision(system)
    check_period(system, args, x0, v0)
    end = whole_number("num_periods", num_periods) * system.forcing.period
    settings = Settings(0, max_steps, max_reverse_steps, (RESULTS.max_events_reached,))
    sol = follow(system, 0.0, end, x0, v0, settings, flow=flow, args=args)
    return sol.x1, sol.v1


def check_period(system: ImpactSystem, args: object, x0: Numbers, v0: Numbers) -> None:
    """Refuse a load without a period, and a force of another one, where their numbers are known."""
    frequency = concrete(system.forcing.frequency)
    if frequency is not None and not frequency > 0:
        raise ValueError("The load has no frequency, so there is no forcing period: use `vx.simulate`.")
    bound = with_args(system, args)
    is_traced = any(concrete(leaf) is None for leaf in jax.tree.leaves(bound))
    if bound.force is None or is_traced or not np.asarray(bound.forcing.frequency) > 0:
        return
    # A start that is differentiated is not known, but its place among the stops hardly matters.
    starts = (concrete(as_float(a)) for a in (x0, v0))
    x, v = (np.zeros(bound.num_masses) if a is None else a for a in starts)
    one_lane = lambda a: np.asarray(a)[..., None]  # noqa: E731
    with jax.ensure_compile_time_eval():
        refuse_off_period(jax.tree.map(one_lane, bound), x[:, None], v[:, None], who="the stroboscopic map")


@padding_allowed
def monodromy_matrix(
    system: ImpactSystem,
    x0: Numbers,
    v0: Numbers,
    num_periods: Count = 1,
    *,
    flow: AbstractFlow | None = None,
    args: object = None,
    max_steps: Count | None = None,
) -> Float[Array, "state state"]:
    """Derivative of the stroboscopic map by the state (x, v).

    On a periodic orbit its eigenvalues are the Floquet multipliers.

    Args:
        system: the machine.
        x0: positions at phase 0, (n,).
        v0: velocities, (n,).
        num_periods: forcing periods, the period of the orbit.
        flow: as for `simulate`.
        args: likewise.
        max_steps: likewise.

    Returns:
        The matrix, (2 n, 2 n).

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        matrix = vx.monodromy_matrix(system, [0.0, 0.0], [0.0, 0.0])
        ```

    References:
        Wagg & Bishop (2004), Sec. 2.2; M. di Bernardo et al., Piecewise-smooth Dynamical Systems
        (2008), Sec. 2.5.
    """
    n = system.num_masses
    start = jnp.concatenate([as_float(x0), as_float(v0)])

    def strobe(y: Float[Array, " state"]) -> Float[Array, " state"]:
        end = stroboscopic_map(system, y[:n], y[n:], num_periods, flow=flow, args=args, max_steps=max_steps)
        return jnp.concatenate(end)

    return jax.jacfwd(strobe)(start)


def saltation_matrix(
    system: ImpactSystem, t: ArrayLike, x: Numbers, v: Numbers, stop: int, *, args: object = None
) -> Float[Array, "state state"]:
    """Derivative of the state just after an impact by the state just before, no other mass held.

    With the derivative R of the reset (v_i to -r v_i), the gap g, and the vector fields f- = (v-, a-) and f+
    before and after: S = R + (f+ - R f-) (dg/dy) / (dg/dy f-). It is infinite at a grazing impact. All is as
    seen from the stops, where they move.

    Args:
        system: the machine.
        t: time of the impact.
        x: positions, (n,).
        v: velocities before the impact, (n,).
        stop: index of the stop that is hit.
        args: as for `simulate`.

    Returns:
        The matrix for the state (x, v), (2 n, 2 n).

    Example:
        ```python
        import vijax as vx
        system = vx.models.wagg_bishop_a(0.8)
        matrix = vx.saltation_matrix(system, 1.0, [0.3, 0.1], [0.5, 0.0], stop=0)
        ```

    References:
        M. di Bernardo et al., Piecewise-smooth Dynamical Systems (2008), Sec. 2.5.
    """
    x, v, time = as_float(x), as_float(v), as_float(t)
    system, n = with_args(system, args), system.num_masses
    machine = prepare(numbers_of(system), jnp.ones_like(time), (time, x, v), can_stick=False)
    phase = machine.phase_at(time)
    is_hit = jnp.arange(machine.contacts.num) == stop
    # Seen from the stops, which stand still there; at one instant that changes no derivative by the state.
    y = jnp.concatenate(machine.seen_from_stops(phase, x, v))

    def field(y: Float[Array, " state"]) -> Float[Array, " state"]:
        state = resting_state(machine, phase, y[:n], y[n:], jnp.zeros_like(is_hit))
        return jnp.concatenate([state.v, machine.pull(machine.total_force(state))])

    def reset(y: Float[Array, " state"]) -> Float[Array, " state"]:
        return jnp.concatenate(rebound(machine, y[:n], y[n:], is_hit))

    def gap(y: Float[Array, " state"]) -> Float[Array, ""]:
        return machine.contacts.gaps(y[:n])[stop]

    slope, before = jax.jacfwd(reset)(y), field(y)
    towards = jax.grad(gap)(y)
    return slope + jnp.outer(field(reset(y)) - slope @ before, towards / (towards @ before))
