"""Record of the events at the end of a step."""

import equinox as eqx
from jaxtyping import Array, Bool, Float

from .._jax.arrays import Flag, Scalar


class Instant(eqx.Module):
    """Events at the end of a step.

    Attributes:
        hit: flags of impacts, (stops,).
        stuck: flags of stops on which a mass comes to rest, (stops,).
        released: flags of stops that release their mass, (stops,).
        velocity_minus: velocity of each stop's mass before the impacts, (stops,).
        velocity_plus: velocity after them, before sticking, (stops,).
        chatter: time from this instant to the end of the skipped bounces of the stuck, (stops,).
        arrived: True where the step ends at the target time.
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
