"""Motion of a linear machine between events by the Taylor series of `series.py`."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar
from .._jax.xla import compute_once
from .._machine.contacts import Held
from .._machine.derivatives import Derivatives
from .._machine.machine import Machine
from .._machine.state import State
from .exact_step import ExpandingFlow
from .exponential import exponential_increments
from .interface import Expansion, FlightMotion, PhaseChange, StepMotion
from .series import horner, next_coefficients, orders, rows_of_state, sum_series, taylor_series, vector

_ORDER_AND_TRUST = {"float64": (22, 1.5), "float32": (11, 1.0)}


class TaylorFlow(ExpandingFlow):
    """Motion by Taylor series: exact for a linear machine, to a tolerance for one with a `force`.

    A linear machine has its series to rounding, whatever the arguments are. A `force` is traced once, and its operations
    give the series of the motion order by order. Steps are as long as the last two orders allow, and as the derivatives
    of the motion by its start allow. It is refused with the name of the operation where a force has no series.

    Args:
        order: last order of the series of a machine with a `force`.
        tolerance: bound of the last terms in a step of such a machine, relative to the motion in the step.

    Raises:
        ValueError: for an order that is not a whole number from 6 to 40, or a tolerance that is not between 0 and 1.

    Example:
        ```python
        import vijax as vx
        pendulum = vx.ImpactSystem(
            [1.0], [[0.1]], [[0.0]], vx.HarmonicForcing([0.3], 1.2), [vx.Stop(0, 0.5, 0.8)],
            force=lambda t, x, v, args: -args["g"] * vx.jnp.sin(x),
        )
        sol = vx.simulate(pendulum, 0.0, 50.0, args={"g": 1.0}, flow=vx.TaylorFlow(order=20, tolerance=1e-14))
        ```

    References:
        A. Jorba and M. Zou, Exp. Math. 14 (2005), 99-117.
    """

    has_flow_map: ClassVar[bool] = True

    order: int = eqx.field(static=True, default=16)
    tolerance: float = eqx.field(static=True, default=1e-12)

    def __check_init__(self):
        if not (isinstance(self.order, int) and 6 <= self.order <= 40):
            raise ValueError(f"Argument `order` must be a whole number from 6 to 40, but is {self.order!r}.")
        if not (isinstance(self.tolerance, float) and 0 < self.tolerance < 1):
            raise ValueError(f"Argument `tolerance` must be between 0 and 1, but is {self.tolerance!r}.")

    def expand(self, machine: Machine, state: State, hold: Held) -> "TaylorExpansion":
        """Compute the Taylor series of the motion at `state`."""
        order, trust = _ORDER_AND_TRUST[str(state.x.dtype)]
        x, force, phase = taylor_series(machine, state, hold, order)
        now = Derivatives(2 * x[2], 6 * x[3], force[0], force[1], 2 * force[2])
        return TaylorExpansion(now, trust * machine.timescale, x, force, phase)

    def propagate(self, machine: Machine, state: State, hold: Held, step: Scalar) -> StepMotion:
        """Sum the series term by term, without storing it."""
        order, _ = _ORDER_AND_TRUST[str(state.x.dtype)]
        extend, start = next_coefficients(machine, hold), rows_of_state(state)

        def add(carry, order):
            (k, *_), (last, power, totals) = order, carry
            now, (x, _, phase) = compute_once(extend, last, order)
            power = power * step
            displacement, v, waves = totals
            totals = (
                [d + power * step * row for d, row in zip(displacement, x, strict=True)],
                [d + (k + 2) * power * row for d, row in zip(v, x, strict=True)],
                [d + power * row for d, row in zip(waves, phase, strict=True)],
            )
            return (now, power, totals), None

        _, v, phase = start
        unmoved = [jnp.zeros_like(row) for row in phase]
        first = (start, jnp.ones_like(step), ([step * row for row in v], v, unmoved))
        (_, _, (displacement, v, phase)), _ = jax.lax.scan(add, first, orders(order, state), unroll=5)
        n = len(state.x)
        return vector(displacement, n), vector(v, n), jnp.stack(phase).reshape(state.phase.shape)

    def flow_map(
        self, machine: Machine, state: State, hold: Held, span: Scalar, change: PhaseChange
    ) -> FlightMotion:
        """Follow a whole flight by the matrix exponential."""
        del change
        return exponential_increments(machine, state, hold, span)


class TaylorExpansion(Expansion):
    """Taylor coefficients of positions, forces and phase."""

    now: Derivatives
    limit: Scalar
    x: Float[Array, "_ n ..."]
    forces: Float[Array, "_ n ..."]
    phase: Float[Array, "_ 2 harmonics ..."]

    @property
    def series(self) -> tuple[Array, ...]:
        """All orders of which each has one."""
        return self.x[: len(self.phase)], self.forces, self.phase

    def rest(self, machine: Machine, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 on [0, limit] by sums of absolute coefficients."""
        del machine
        return horner(jnp.abs(self.x[4:]), limit), horner(jnp.abs(self.forces[3:]), limit)

    def velocity_rest(self, machine: Machine, limit: Scalar) -> Float[Array, "n ..."]:
        """Bound |v^(4)| / 24 by the sum of absolute coefficients."""
        del machine
        return horner([(k + 1) * jnp.abs(self.x[k + 1]) for k in range(4, len(self.x) - 1)], limit)

    def move(self, machine: Machine, state: State, step: Scalar) -> StepMotion:
        """Sum the series at `step`."""
        del machine, state
        return sum_series(self.x, self.phase, step)
