"""First-order states beside a machine: circuits, controllers, filters.

A state z with z' = P z + Q x + R x' is the velocity of one more coordinate of unit mass, z = y', whose position nothing
depends on. So the machine stays linear and of second order, with

    C = [[C, -F], [-R, -P]],  K = [[K, 0], [-Q, 0]],

and everything that holds for a machine holds for it. y would drift, a neutral direction of every orbit; the engine keeps it
at 0 (`Machine.moved`). Rejected: states of their own in the engine, a third kind of unknown in each of its formulas.
"""

import jax.numpy as jnp

from .._jax.arrays import Numbers, as_float, check_type
from .checks import check_shape
from .system import ImpactSystem


def with_states(
    system: ImpactSystem,
    dynamics: Numbers,
    feedback: Numbers,
    *,
    of_positions: Numbers | None = None,
    of_velocities: Numbers | None = None,
) -> ImpactSystem:
    """Add first-order states to a machine: a circuit, a controller, a filter.

    The states z obey z' = P z + Q x + R x', and the masses feel the force F z besides all others. In results z are the last
    `num_states` velocities: `sol.v1[-m:]` and so on. The positions of these coordinates are 0. An orbit has a multiplier 0
    for each of them, beside those of masses and states.

    Numbers of the machine keep their paths. Those of the states are entries of the matrices of the new one,
    C = [[C, -F], [-R, -P]] and K = [[K, 0], [-Q, 0]]: with one mass and one state `"damping[1][1]"` is -P. To drive states
    by a load, write such a machine as `vx.ImpactSystem(..., num_states=m)`.

    Args:
        system: a machine of n coordinates, without `force`.
        dynamics: P, (m, m).
        feedback: F, (n, m): the force on each mass by unit states.
        of_positions: Q, (m, n); zero if left out.
        of_velocities: R, (m, n); zero if left out.

    Returns:
        The machine of n + m coordinates.

    Raises:
        ValueError: for wrong shapes, or a machine with a `force` or `parametric`.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic([1.0], 0.8)
        beam = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, [vx.Stop(0, 1.0)])
        # Voltage of a piezoelectric patch: V' = -0.05 V - 0.5 x', which pulls the beam by 0.05 V.
        harvester = vx.with_states(beam, [[-0.05]], [[0.05]], of_velocities=[[-0.5]])
        ```

    References:
        A. Erturk & D. J. Inman, J. Intell. Mater. Syst. Struct. 19 (2008), for the circuit of a harvester.
    """
    check_type("system", system, ImpactSystem, "one machine, a `vx.ImpactSystem`")
    if system.force is not None:
        raise ValueError(
            "`with_states` is for machines without `force` and `parametric`: write this one as `vx.ImpactSystem(..., num_states=m)`, with a force "
            "of all coordinates."
        )
    p, f, n = as_float(dynamics, "dynamics"), as_float(feedback, "feedback"), system.num_masses
    m = len(p) if p.ndim else 0
    q, r = (
        as_float(jnp.zeros((m, n)) if a is None else a, name)
        for a, name in ((of_positions, "of_positions"), (of_velocities, "of_velocities"))
    )
    shapes = {
        "dynamics": (p, (m, m)),
        "feedback": (f, (n, m)),
        "of_positions": (q, (m, n)),
        "of_velocities": (r, (m, n)),
    }
    for name, (value, shape) in shapes.items():
        check_shape(name, value, shape)
    if m == 0:
        raise ValueError("Argument `dynamics` must have one row for each state, shape (m, m), but has none.")
    mass = system.mass
    if mass.ndim == 1:
        mass = jnp.concatenate([mass, jnp.ones(m)])
    else:
        mass = jnp.block([[mass, jnp.zeros((n, m))], [jnp.zeros((m, n)), jnp.eye(m)]])
    return ImpactSystem(
        mass,
        jnp.block([[system.damping, 0 - f], [0 - r, 0 - p]]),  # no -0
        jnp.block([[system.stiffness, jnp.zeros((n, m))], [0 - q, jnp.zeros((m, m))]]),
        system.forcing.with_more(m),
        system.stops,
        friction=system.friction,
        hysteresis=system.hysteresis,
        num_states=system.num_states + m,
    )
