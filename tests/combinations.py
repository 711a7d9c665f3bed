"""Machines of all kinds, each written in two ways that move alike, and what is asked of each.

Every answer about a machine is held against runs and orbits of its twin, which goes through other code: a spring as a force, a
compliant stop as a choice in a force, a parametric term as a force of time, one Jenkins element as two.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import vijax as vx

# Load, its frequency, the position of the stop.
LOAD, FREQUENCY, POSITION = 0.5, 2.2, 0.1
# Friction of a constant force, and the same of a contact that the force 1 presses.
CONSTANT, PRESSED = {"force": 0.05}, {"coefficient": 0.05, "contact": 1}


class Spring(eqx.Module):
    """Springs of the masses to the ground."""

    stiffness: jax.Array

    def __call__(self, t, x, v, args):
        return -self.stiffness * x


class Choice(eqx.Module):
    """A spring that acts beyond a position alone."""

    stiffness: float
    position: float

    def __call__(self, t, x, v, args):
        return -self.stiffness * jnp.where(x > self.position, x - self.position, 0.0)


class Table(eqx.Module):
    """A spring whose force stands in a table."""

    positions: jax.Array
    forces: jax.Array

    def __call__(self, t, x, v, args):
        return jnp.interp(x, self.positions, self.forces)


class Mathieu(eqx.Module):
    """A spring whose stiffness changes with the load."""

    stiffness: float
    frequency: jax.Array

    def __call__(self, t, x, v, args):
        return -self.stiffness * jnp.cos(self.frequency * t) * x


class Kind(NamedTuple):
    """A kind of machine.

    Attributes:
        of: from the frequency of the load and the position of the stop to the machine.
        twin: to the same machine written in another way.
        frequency: name of the frequency.
        position: name of the position.
    """

    of: Callable[[Any, Any], Any]
    twin: Callable[[Any, Any], Any]
    frequency: str = "forcing.frequency"
    position: str = "stops[0].position"


def machine(frequency=FREQUENCY, position=POSITION, load=None, stiffness=1.0, stops=(), **parts):
    """One mass between a spring and a stop."""
    load = vx.Harmonic([LOAD], frequency) if load is None else load
    first = vx.Stop(0, position, "upper", 0.7)
    return vx.ImpactSystem([1.0], [[0.1]], [[stiffness]], load, [first, *stops], **parts)


def rubbing(frequency, position, friction, stiffness=1.0, force=None):
    """A mass between a spring and a stop, and a second one whose weight presses it with the force 1."""
    load = vx.Harmonic([LOAD, 0.0], frequency, mean=[0.0, -1.0])
    stops = [vx.Stop(0, position, "upper", 0.7), vx.Contact({1: -1.0}, 0.0, restitution=0.5)]
    dampers, springs = np.diag([0.1, 0.0]), np.diag([stiffness, 1.0])
    pad = [vx.Friction({0: 1.0}, **friction)]
    return vx.ImpactSystem([1.0, 1.0], dampers, springs, load, stops, force=force, friction=pad)


def triangle(frequency, knots):
    """A triangular wave with its corners and other knots between them."""
    phases = np.linspace(0, 2 * np.pi, knots + 1)[:-1]
    values = np.interp(phases, np.linspace(0, 2 * np.pi, 5), [0.02, 0.0, -0.02, 0.0, 0.02])
    return vx.Waveform(phases, values[:, None], frequency, "linear")


def plain(w, s):
    """The machine as a function of two values."""
    return machine(w, s)


def hung(w, s):
    """Three fifths of the spring as a force."""
    return machine(w, s, stiffness=0.4, force=Spring(jnp.asarray([0.6])))


def mixed(w, s):
    """A moving base, a force, two Jenkins elements side by side and a parametric term."""
    load = vx.base_excitation([1.0], LOAD / w**2, w)
    slips = [vx.Jenkins(0, 0.025, 0.00125)] * 2
    term = vx.Parametric([[[0.05]]])
    return machine(w, s, load, 0.65, force=Spring(jnp.asarray([0.3])), hysteresis=slips, parametric=term)


def mixed_otherwise(w, s):
    """The same with a load, the parametric term as a force, and one Jenkins element."""
    return machine(w, s, stiffness=0.95, force=Mathieu(0.05, w), hysteresis=[vx.Jenkins(0, 0.05, 0.0025)])


def as_family(function):
    """Function from values to a family, of the function that gives its machines."""
    return lambda w, s: vx.Family(function, w=w, s=s)


def record(knots):
    """A machine that shakes by a record with knots in equal distances, on which it is linear."""

    def of(w, s):
        times = np.linspace(0.0, 20.0, knots)
        values = np.interp(times, np.linspace(0.0, 20.0, 41), LOAD * np.cos(2.2 * np.linspace(0.0, 20.0, 41)))
        return machine(w, s, vx.Tabulated(times, values[:, None]))

    return of


def two_frequencies(w, s):
    """A load that never repeats."""
    return machine(w, s, vx.Harmonic([LOAD], w) + vx.Harmonic([0.1], 1.3))


def two_otherwise(w, s):
    """The same, the second load as a force of time."""
    return machine(w, s, force=lambda t, x, v, args: 0.1 * jnp.cos(1.3 * t) + 0 * x)


KINDS = {
    "harmonic load": Kind(machine, hung),
    "wave form": Kind(
        lambda w, s: machine(w, s, vx.Harmonic([LOAD], w) + triangle(w, 4)),
        lambda w, s: machine(w, s, vx.Harmonic([LOAD], w) + triangle(w, 8)),
    ),
    "moving base": Kind(lambda w, s: machine(w, s, vx.base_excitation([1.0], LOAD / w**2, w)), machine),
    "force": Kind(hung, machine),
    "force with a choice": Kind(
        lambda w, s: machine(w, s, force=Choice(0.5, 0.0)),
        lambda w, s: machine(w, s, stops=[vx.CompliantStop(0, 0.0, "upper", 0.5)]),
    ),
    "force with a table": Kind(
        lambda w, s: machine(
            w, s, stiffness=0.4, force=Table(jnp.linspace(-6.0, 6.0, 4), jnp.linspace(3.6, -3.6, 4))
        ),
        machine,
    ),
    "parametric terms": Kind(
        lambda w, s: machine(w, s, parametric=vx.Parametric([[[0.1]]])),
        as_family(lambda w, s: machine(w, s, force=Mathieu(0.1, w))),
    ),
    "compliant stop": Kind(
        lambda w, s: machine(w, s, stops=[vx.CompliantStop(0, 0.0, "upper", 0.5)]),
        lambda w, s: machine(w, s, force=Choice(0.5, 0.0)),
    ),
    "friction": Kind(
        lambda w, s: machine(w, s, friction=[vx.Friction(0, 0.05)]),
        lambda w, s: machine(w, s, friction=[vx.Friction(0, 0.02), vx.Friction(0, 0.03)]),
    ),
    "friction of a contact": Kind(lambda w, s: rubbing(w, s, PRESSED), lambda w, s: rubbing(w, s, CONSTANT)),
    "Jenkins element": Kind(
        lambda w, s: machine(w, s, stiffness=0.95, hysteresis=[vx.Jenkins(0, 0.05, 0.0025)]),
        lambda w, s: machine(w, s, stiffness=0.95, hysteresis=[vx.Jenkins(0, 0.025, 0.00125)] * 2),
    ),
    "family": Kind(as_family(plain), machine, "w", "s"),
    "mixture": Kind(mixed, as_family(mixed_otherwise)),
    "friction beside a force": Kind(
        lambda w, s: rubbing(w, s, PRESSED, 0.4, Spring(jnp.asarray([0.6, 0.0]))),
        lambda w, s: rubbing(w, s, CONSTANT),
    ),
    "record": Kind(record(41), record(81), "damping[0][0]"),
    "two frequencies": Kind(two_frequencies, two_otherwise, "forcing[0].frequency"),
}
