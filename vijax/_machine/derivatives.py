"""Exact derivatives at one instant: force -> acceleration -> rate of force -> jerk -> curvature of force."""

from itertools import accumulate, repeat

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._jax.arrays import matvec
from .contacts import Held
from .machine import Machine
from .state import State


class Rates(eqx.Module):
    """Forces, accelerations and their rates at one instant. Every field is (n,), lanes last.

    Attributes:
        acceleration: second derivative of the position of every mass, contact forces included.
        jerk: third derivative, likewise.
        force: force on every mass without contact forces.
        force_rate: its first derivative.
    """

    acceleration: Float[Array, "n ..."]
    jerk: Float[Array, "n ..."]
    force: Float[Array, "n ..."]
    force_rate: Float[Array, "n ..."]


class Derivatives(Rates):
    """Rates, and one more order of the force.

    Attributes:
        force_curvature: second derivative of the force.
    """

    force_curvature: Float[Array, "n ..."]


def rates(machine: Machine, state: State, hold: Held) -> Rates:
    """Forces and accelerations with the contacts of `hold` closed, see `Machine.hold`, and their rates."""
    force = machine.total_force(state)
    acceleration = machine.contacts.accelerations(force, hold, state.phase)
    force_rate = machine.total_force_rate(state, acceleration)
    jerk = machine.contacts.accelerations(force_rate, hold, machine.phase_rate(state.phase))
    return Rates(acceleration, jerk, force, force_rate)


def derivatives(machine: Machine, state: State, hold: Held) -> Derivatives:
    """`rates` with the curvature of the force."""
    now = rates(machine, state, hold)
    curvature = machine.total_force_curvature(state, now.acceleration, now.jerk)
    return Derivatives(now.acceleration, now.jerk, now.force, now.force_rate, curvature)


def contact_forces(machine: Machine, state: State, hold: Held, now: Derivatives) -> list[Array]:
    """Contact forces of the contacts that hold, and their first two derivatives, (contacts, ...) each."""
    forces = now.force, now.force_rate, now.force_curvature
    phases = _phases(machine, state, len(forces))
    return [machine.contacts.contact_force(f, hold, p) for f, p in zip(forces, phases, strict=True)]


def sizes_of_force(
    machine: Machine,
    load: Float[Array, "n ..."],
    x_size: Float[Array, "n ..."],
    v_size: Float[Array, "n ..."],
    order: int = 0,
) -> Float[Array, "n ..."]:
    """Sum of the sizes of the terms of a force, or of a derivative of it: what its rounding errors are relative to.

    Args:
        machine: the machine.
        load: the force, or its derivative.
        x_size: sizes of the positions, or of their derivative of the same order.
        v_size: those of the velocities.
        order: of the derivative.
    """
    own = jnp.abs(load) + machine.waves.rate_bound(order, machine.pace)
    own = own if order else own + jnp.abs(machine.mean)
    own = own if machine.tables is None else own + machine.tables.bound(order)
    return own + matvec(jnp.abs(machine.damping), v_size) + matvec(jnp.abs(machine.stiffness), x_size)


def approaches(machine: Machine, state: State, now: Rates) -> list[Array]:
    """Speeds of approach to the contacts, and their first two derivatives, (contacts, ...) each."""
    moves = state.v, now.acceleration, now.jerk
    phases = _phases(machine, state, len(moves) + 1)[1:]
    return [machine.contacts.towards(a, p) for a, p in zip(moves, phases, strict=True)]


def approach_snap(machine: Machine, state: State, hold: Held, now: Derivatives) -> Array:
    """Third derivative of the speeds of approach to the contacts, (contacts, ...)."""
    phases = _phases(machine, state, 5)
    snap = machine.contacts.accelerations(now.force_curvature, hold, phases[2])
    return machine.contacts.towards(snap, phases[4])


def _phases(machine: Machine, state: State, count: int) -> list[Array]:
    """Phase of the load and its derivatives, `count` in all; not computed where no contact moves."""
    if machine.contacts.walls is None:
        return [state.phase] * count
    steps = repeat(None, count - 1)
    return list(accumulate(steps, lambda phase, _: machine.phase_rate(phase), initial=state.phase))
