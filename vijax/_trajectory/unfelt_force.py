"""Warning of a force that no step has felt.

A machine at rest gives the solver no error to control, so its steps grow, and a short pulse may fall between the times at
which the force is evaluated. Then the machine stays where it started, exactly.
"""

import warnings
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from .._jax.arrays import Reals
from .._jax.users_line import users_line
from .._system.force import force_of
from .._system.hysteresis import ForceBesideSliders
from .._system.system import ImpactSystem

# Times at which the force is looked at; a pulse as short as this part of the run is found.
_TIMES = 2**16


def warn_of_unfelt_force(
    system: ImpactSystem, span: tuple[Reals, Reals], start: tuple[Reals, Reals], solution: Any
) -> None:
    """Warn if the machine never moved although its `force` changes in time; a call is free of cost where it moved."""
    force, (x, v) = force_of(system), start
    if force is None or system.friction or not _is_unmoved(solution, x, v):
        return
    times = np.linspace(np.asarray(span[0]), np.asarray(span[1]), _TIMES)
    force = ForceBesideSliders(force, len(system.hysteresis))
    forces = np.asarray(_at_all(force, times, x, v))
    acts = np.any(forces != forces[0], axis=1)
    if acts.any():
        warnings.warn(
            f"The machine stayed at rest, but its `force` changes at t = {times[acts.argmax()]:.6g}: no step of the solver saw "
            "it. Run up to that time and go on from there, or bound the steps by `dtmax` of a `diffrax.PIDController` in "
            "`flow=vx.DiffraxFlow(stepsize_controller=...)`.",
            stacklevel=users_line(),
        )


@eqx.filter_jit
def _at_all(force: Any, times: Reals, x: Reals, v: Reals) -> Array:
    return jax.vmap(force, (0, None, None))(times, x, v)


def _is_unmoved(solution: Any, x: Reals, v: Reals) -> bool:
    """Test whether the motion ended where it started, at rest, with no mass held: a held one may rest under any force."""
    if np.any(v) or np.any(np.asarray(solution.stuck1)):
        return False
    return np.array_equal(solution.x1, x) and not np.any(np.asarray(solution.v1))
