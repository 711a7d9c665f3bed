"""Forces on the masses besides the linear ones, over lanes, in the frame of the machine."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import Scalar, over_lanes
from .._system.force import BoundForce
from .._system.hysteresis import ForceBesideSliders
from .frame import Frame


class ExtraForce(eqx.Module):
    """Force on the masses besides the linear ones.

    Attributes:
        force: function of time, positions and velocities of one trajectory.
        origin: time from which the forcing periods are counted.
        frame: frame of the arguments x and v; the force itself takes positions and velocities in space.
    """

    force: BoundForce | ForceBesideSliders
    origin: Scalar
    frame: Frame | None = None

    def __call__(
        self, t: Scalar, x: Float[Array, "n ..."], v: Float[Array, "n ..."]
    ) -> Float[Array, "n ..."]:
        if self.frame is not None:
            w, rate = self.frame.at_time(t)
            x, v = x + w, v + rate
        return over_lanes(lambda force, t, x, v: force(t, x, v), x, self.force, t, x, v)

    def rate(self, t: Scalar, x: Float[Array, "n ..."], v: Float[Array, "n ..."], mass: Array) -> Scalar:
        """Estimate, from one state, of the frequency or decay rate that the force adds to the motion; a constant.

        Its derivatives are infinite where a force has no slope, and would only be those of step lengths. Where a force has an
        infinite slope itself, or none, it adds nothing: x sqrt(abs(x)) has 0 * inf at 0.
        """

        def of_one(force, t, x, v, mass):
            by_x, by_v = jax.jacfwd(force, (1, 2))(t, x, v)
            root = jnp.sqrt(mass)
            w2, d = (jnp.linalg.norm(a / (root[:, None] * root[None])) for a in (by_x, by_v))
            rate = (d + jnp.sqrt(d * d + 4 * w2)) / 2
            return jnp.where(jnp.isfinite(rate), rate, 0.0)

        return jax.lax.stop_gradient(over_lanes(of_one, x, self.force, t, x, v, mass))
