"""Impacts at the very end of a forcing period, which rounding puts before it or after it.

Each reverses velocities, so that one cycle would look like two, or like none: all states are taken on one side of them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from .._hybrid.law import before, rebound
from .._jax.arrays import Reals
from .._jax.xla import compile_lightly
from .._machine.first_state import state_before_contact
from .._machine.machine import Machine
from .._machine.numbers import numbers_of
from .._machine.preparation import prepare
from .._machine.state import State
from .._system.system import ImpactSystem

_prepared = compile_lightly(prepare)  # compiling it operation by operation would take seconds


def machines_of_lanes(system: ImpactSystem) -> Machine:
    """Prepared machines side by side, for computations at one instant."""
    one = jax.device_put(np.ones(1, system.mass.dtype))
    with jax.numpy_rank_promotion("allow"):  # leaves that all points share are broadcast
        # Span and start only affect steps and forces.
        return _prepared(numbers_of(system), one, (0 * one, one, one), can_stick=False)


def padded_to_power_of_two(which: np.ndarray) -> np.ndarray:
    """Indices of points, repeated up to a power of two of them, as every count is compiled for."""
    return np.resize(which, 1 << (len(which) - 1).bit_length())


def after_impacts(
    machine: Machine, angle: float, states: tuple[np.ndarray, np.ndarray], closed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities after the impacts with contacts that are closed and approached.

    Args:
        machine: lanes last.
        angle: the phase of the load.
        states: positions and velocities before, (lanes, n) each.
        closed: flags of the closed contacts, (contacts, lanes), without rows for friction and Jenkins elements.
    """
    with jax.numpy_rank_promotion("allow"):
        x, v = _after(machine, angle, states[0].T, states[1].T, closed)
    return np.asarray(x).T, np.asarray(v).T


def before_impact(
    machine: Machine, angle: float, v: np.ndarray, stop: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Velocities before one impact of each lane.

    Args:
        machine: lanes last.
        angle: the phase of the load.
        v: velocities after it, (lanes, n); velocities that are already those before it stay as they are.
        stop: index of the contact that was hit, (lanes,).
        velocity: velocity before the impact as logged, (lanes,).
    """
    with jax.numpy_rank_promotion("allow"):
        return np.asarray(_before(machine, angle, v.T, stop, velocity)).T


@compile_lightly
def _after(machine: Machine, angle: ArrayLike, x: Reals, v: Reals, closed: Reals) -> tuple[Reals, Reals]:
    state = _state(machine, angle, x, v)
    contacts = machine.contacts
    of_friction = jnp.zeros((contacts.num - len(closed), closed.shape[1]), bool)
    hit = jnp.concatenate([closed, of_friction]) & contacts.is_rigid & (machine.approach(state) > 0)
    after = eqx.tree_at(lambda s: (s.x, s.v), state, rebound(machine, state, hit))
    return machine.in_space(after)


@compile_lightly
def _before(machine: Machine, angle: ArrayLike, v: Reals, stop: Reals, velocity: Reals) -> Reals:
    state = _state(machine, angle, jnp.zeros_like(v), v)
    own = machine.velocity_of_stops(state.phase)
    hit = jnp.arange(machine.contacts.num)[:, None] == stop
    approach = machine.contacts.signed(jnp.where(hit, velocity, 0) - (0 if own is None else own))
    return machine.in_space(eqx.tree_at(lambda s: s.v, state, before(machine, state, hit, approach)))[1]


def _state(machine: Machine, angle: ArrayLike, x: Reals, v: Reals) -> State:
    phase = machine.phase_at(jnp.asarray(angle / machine.frequency))
    x, v = machine.relative_to_stops(phase, jnp.asarray(x), jnp.asarray(v))
    return state_before_contact(machine, phase, x, v, jnp.zeros((machine.contacts.num, x.shape[1]), bool))
