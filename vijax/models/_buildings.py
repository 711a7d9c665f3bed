"""Buildings in earthquakes."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import evaluate_eagerly
from .._system.base import base_excitation
from .._system.checks import check_shape
from .._system.contact import Contact
from .._system.system import ImpactSystem
from .._system.tabulated import Tabulated


@evaluate_eagerly
def pounding_buildings(
    times: Numbers,
    acceleration: Numbers,
    *,
    gap: ArrayLike = 0.05,
    periods: Numbers = (0.6, 1.2),
    masses: Numbers = (1.0, 1.0),
    damping_ratio: ArrayLike = 0.05,
    restitution: ArrayLike = 0.65,
    kind: str = "linear",
) -> ImpactSystem:
    """Build two buildings side by side that pound in an earthquake.

    Each is one mass on a spring and a damper to the ground: x'' + 2 zeta w x' + w^2 x = -y''(t), with x relative to the ground, w
    its natural frequency and y'' the acceleration of the ground. They collide at the height of the roofs where
    x_0 - x_1 = gap.

    Args:
        times: times of the record, rising, (times,).
        acceleration: y'' at these times, (times,).
        gap: distance of the buildings at rest, positive.
        periods: natural periods, (2,).
        masses: (2,).
        damping_ratio: zeta of both.
        restitution: of the blow; 0.65 for concrete.
        kind: of the record between its times, see `vx.Tabulated`.

    Returns:
        The machine. The quantity "max_absolute_acceleration" of a sweep is that in space, what the content of the building feels.

    Raises:
        ValueError: unless there are two periods and two masses, and as `vx.Tabulated`.

    Example:
        ```python
        import numpy as np, vijax as vx
        t = np.linspace(0.0, 10.0, 501)
        system = vx.models.pounding_buildings(t, 3.0 * np.sin(6.0 * t) * np.sin(0.3 * t))
        ds = vx.sweep(system, {"stops[0].position": [0.05, 0.1, 0.2]}, duration=20.0)
        print(ds.num_impacts.values)
        ```

    References:
        S. A. Anagnostopoulos, "Pounding of buildings in series during earthquakes", Earthquake Engineering and Structural
        Dynamics 16 (1988) 443-456.
    """
    mass, period = as_float(masses), as_float(periods)
    for name, value in (("masses", mass), ("periods", period)):
        check_shape(name, value, (2,))
    w = 2 * np.pi / period
    load = base_excitation(mass, acceleration=Tabulated(times, acceleration, kind))
    damping = jnp.diag(2 * as_float(damping_ratio) * w * mass)
    contact = Contact({0: 1.0, 1: -1.0}, gap, restitution)
    return ImpactSystem(mass, damping, jnp.diag(w**2 * mass), load, [contact])
