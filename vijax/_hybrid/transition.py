"""What happens at the end of a step."""

import equinox as eqx
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Flag, Scalar


class Instant(eqx.Module):
    """What happened at the end of a step.

    Attributes:
        hit: impacts, (stops,).
        stuck: masses that came to rest on their stop, (stops,).
        released: masses that were let go, (stops,).
        velocity_minus: velocity of each stop's mass before, (stops,).
        velocity_plus: and after, before it sticks, (stops,).
        chatter: how long after this instant the skipped bounces of the stuck end, (stops,).
        arrived: whether the step ended at the target time.
        time: local time of the instant.
        impulse: of each impact, along its row, (stops,); None where it follows from the velocities alone.
    """

    hit: Bool[Array, "stops ..."]
    stuck: Bool[Array, "stops ..."]
    released: Bool[Array, "stops ..."]
    velocity_minus: Float[Array, "stops ..."]
    velocity_plus: Float[Array, "stops ..."]
    chatter: Float[Array, "stops ..."]
    arrived: Flag
    time: Scalar
    impulse: Float[Array, "stops ..."] | None = None
