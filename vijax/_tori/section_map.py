"""Stroboscopic map of many states at once, with its derivatives by the state and a parameter."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._flow.interface import AbstractFlow
from .._jax.arrays import Reals
from .._jax.xla import compile_lightly
from .._orbits.maps import stroboscopic_map
from .._system.parameters import machine_at
from .._system.system import AnySystem

# States in one call: one program serves any number of them.
_LANES = 64


class Mapped(NamedTuple):
    """States and derivatives of the map, in scaled coordinates.

    Attributes:
        states: images, (angles, 2 n).
        jacobians: derivatives by the states, (angles, 2 n, 2 n).
        slopes: derivatives by the parameter, (angles, 2 n).
    """

    states: np.ndarray
    jacobians: np.ndarray
    slopes: np.ndarray


# Images of scaled states at a scaled value of the parameter.
MapOfStates = Callable[[np.ndarray, float], Mapped]


class SectionMap(NamedTuple):
    """Map from a phase of the load to the same phase a number of forcing periods later.

    Attributes:
        system: the machine, or the family.
        path: of the parameter.
        num_periods: forcing periods of the map.
        phase: of the load at the section, radians.
        flow: as for `simulate`.
        args: likewise.
        scale: of the states, (2 n,).
        span: of the parameter.
    """

    system: AnySystem
    path: str
    num_periods: int
    phase: float
    flow: AbstractFlow | None
    args: Any
    scale: np.ndarray
    span: float

    def __call__(self, states: np.ndarray, parameter: float) -> Mapped:
        """Images of scaled states; NaN where the motion does not reach the section."""
        num = len(states)
        padded = np.concatenate([states, np.repeat(states[-1:], -num % _LANES, axis=0)]) * self.scale
        value, phase = np.asarray(parameter * self.span), np.asarray(self.phase)
        own = self.system, self.path, self.num_periods, self.flow, self.args
        found = [_images(*own, padded[k : k + _LANES], value, phase) for k in range(0, len(padded), _LANES)]
        images, jacobians, slopes = (
            np.concatenate([np.asarray(a) for a in of])[:num] for of in zip(*found, strict=True)
        )
        ratio = self.scale / self.scale[:, None]
        return Mapped(images / self.scale, jacobians * ratio, slopes * self.span / self.scale)


@compile_lightly
def _images(
    system: AnySystem,
    path: str,
    num_periods: int,
    flow: AbstractFlow | None,
    args: Any,
    states: Reals,
    value: Reals,
    phase: Reals,
) -> tuple[Array, Array, Array]:
    def image(z: Array, value: Array) -> tuple[Array, Array]:
        machine, n = machine_at(system, path, value), system.num_coordinates
        x, v = stroboscopic_map(
            machine, z[:n], z[n:], num_periods, phase=phase, flow=flow, args=args, throw=False
        )
        found = jnp.concatenate([x, v])
        return found, found

    derivatives = jax.jacfwd(image, argnums=(0, 1), has_aux=True)
    (jacobians, slopes), images = jax.vmap(derivatives, in_axes=(0, None))(states, value)
    return images, jacobians, slopes
