"""The motion at one instant, exactly: force -> acceleration -> rate of force -> jerk -> curvature of force."""

import equinox as eqx
from jaxtyping import Array, Bool, Float

from .machine import Machine
from .state import State


class Rates(eqx.Module):
    """Forces, accelerations and their rates at one instant. Every field is (n,), lanes last.

    Attributes:
        acceleration: second derivative of the position of every mass; zero where held.
        jerk: third derivative, likewise.
        force: force on every mass without that of the contacts: mass times acceleration where free,
            what presses on the contact where held.
        force_rate: its first derivative.
    """

    acceleration: Float[Array, "n ..."]
    jerk: Float[Array, "n ..."]
    force: Float[Array, "n ..."]
    force_rate: Float[Array, "n ..."]


class Derivatives(Rates):
    """Rates and one order more.

    Attributes:
        force_curvature: second derivative of the force.
    """

    force_curvature: Float[Array, "n ..."]


def rates(machine: Machine, state: State, is_held: Bool[Array, "n ..."]) -> Rates:
    """Forces and accelerations with the masses `is_held` at rest, and their rates."""
    mobility = machine.mobility(is_held)
    force = machine.total_force(state)
    acceleration = mobility * force
    force_rate = machine.total_force_rate(state, acceleration)
    return Rates(acceleration, mobility * force_rate, force, force_rate)


def derivatives(machine: Machine, state: State, is_held: Bool[Array, "n ..."]) -> Derivatives:
    """The same with the curvature of the force."""
    now = rates(machine, state, is_held)
    curvature = machine.total_force_curvature(state, now.acceleration, now.jerk)
    return Derivatives(now.acceleration, now.jerk, now.force, now.force_rate, curvature)
