"""Machines with moving stops."""

import jax.numpy as jnp

import vijax as vx

# Difference of two computations of one motion, rounding magnified by some ten impacts (measured: 2e-14).
MAGNIFIED = 2e-13
W, A, R, GRAVITY = 3.0, 0.3, 0.3, 2.0


def ball(amplitude=A, frequency=W, restitution=R, phase=0.3, **others):
    """A ball on a table, in the fixed frame."""
    return vx.models.ball_on_table(
        frequency, amplitude, phase=phase, restitution=restitution, gravity=GRAVITY, **others
    )


def seen_from_the_table(amplitude=A, frequency=W, restitution=R, phase=0.3):
    """The same machine in the frame of the table."""
    load = vx.base_excitation([1.0], amplitude, frequency, phase, mean=[-GRAVITY])
    return vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0, "lower", restitution)])


def table(t, amplitude=A, frequency=W, phase=0.3):
    """Position and velocity of the table."""
    angle = frequency * t + phase
    return amplitude * jnp.cos(angle), -amplitude * frequency * jnp.sin(angle)


MOTION = vx.Harmonic([[0.1], [0.04]], 1.3, phase=[[0.2], [1.0]], mean=[0.02])


def two_masses(**others):
    """A mass with a fixed wall, and one in a slot that is shaken."""
    slot = [vx.Stop(1, 0.25, "upper", 0.6, MOTION), vx.Stop(1, -0.35, "lower", 0.8, MOTION)]
    load = vx.Harmonic([0.5, 0.0], 1.3)
    stops = [vx.Stop(0, 0.4, "upper", 0.7), *slot]
    return vx.chain([1.0, 0.8], [0.1, 0.05], [1.0, 1.5], load, stops, **others)
