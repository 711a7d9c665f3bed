"""Derivatives of impacts at one instant: each has a time of its own.

Where several masses hit their stops at the same time, as in a symmetric motion, a step ends at the root of one gap. Its time carries
the derivatives of this gap alone; the other gaps are closed there, but in a motion beside they close a little later or earlier:
by the delay d = dg / u, of a gap with the derivative dg and the speed of approach u. Until then the mass moves on as before the impact, and
not as after it. So the position after the impact changes by -v+ d, the velocity by (R a- - a+) d, with the accelerations a- and a+ and the
linear impact law R (M. di Bernardo et al., Piecewise-smooth Dynamical Systems, 2008, Sec. 2.5). Masses that it pulls by dampers feel
its old velocity as long. Where dampers join two masses that hit, the derivatives depend on which hits first: these are the mean of
both orders. Contacts that share inertia, such as those of neighbours in a chain of touching masses, push each other: then the motion itself depends on
the order, and has no derivative.

With friction of contacts the delays are not followed: derivatives of impacts on several contacts at one instant are NaN there.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._jax.arrays import matvec
from .._machine.contacts import Contacts
from .._machine.kinds import JENKINS
from .._machine.machine import Machine
from .._machine.state import State
from .friction_limits import sliding_velocity

# Positions, velocities and gaps after impacts, the speeds of approach of each before and after it, and impulses.
AfterImpacts = tuple[Array, ...]


@eqx.filter_custom_jvp
def at_own_times(
    machine: Machine,
    before: State,
    hit: Bool[Array, "stops ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    gap: Float[Array, "stops ..."],
    minus: Float[Array, "stops ..."],
    plus: Float[Array, "stops ..."],
) -> AfterImpacts:
    """State, speeds of approach and impulses after impacts, with derivatives as if each had its own time.

    Args:
        machine: with stops of single masses.
        before: the state before the impacts.
        hit: flags of the stops hit.
        x: positions after the impacts.
        v: velocities after the impacts.
        gap: gaps of the stops hit, zero.
        minus: speeds of approach to the stops before the impacts.
        plus: those after them.
    """
    del machine, before, hit
    return x, v, gap, minus, plus


@at_own_times.def_jvp
def _at_own_times_jvp(primals, tangents):
    machine, before, hit, x, v, *_ = primals
    found = at_own_times(*primals)
    changes, gap_change = _changes(found, tangents)
    if gap_change is None:
        return found, tuple(changes)
    x_change, v_change, change, minus_change, plus_change = changes
    contacts, hold = machine.contacts, machine.hold(before.held)
    delay = jnp.where(hit, gap_change / jnp.where(hit, contacts.along(before.v), 1), 0)
    of_mass = matvec(jnp.abs(jnp.swapaxes(contacts.rows, 0, 1)), delay)

    def acceleration(x: Array, v: Array) -> Array:
        state = eqx.tree_at(lambda s: (s.x, s.v), before, (x, v))
        return contacts.accelerations(machine.total_force(state), hold, before.phase)

    def reflected(change: Array) -> Array:
        law = lambda v: contacts.reflected(v, hit, jnp.zeros_like(hit), machine.phase_rate(before.phase))  # noqa: E731
        return jax.jvp(law, (before.v,), (change,))[1]

    def by_dampers(v: Array) -> Array:
        n = len(v)
        between = machine.damping * (1 - jnp.eye(n)).reshape(n, n, *[1] * (v.ndim - 1))
        return contacts.accelerations(-matvec(between, v), hold, before.phase)

    loss = before.v - v
    others = by_dampers(loss / 2)  # of the others that hit: half before, half after
    ahead, behind = acceleration(before.x, before.v) - others, acceleration(x, v) + others
    pulled = by_dampers(loss * of_mass)
    gain = ahead * of_mass + pulled / 2
    rebound = reflected(gain)
    return found, (
        x_change - v * of_mass,
        v_change + rebound - behind * of_mass + pulled / 2,
        change + contacts.along(v) * delay,
        minus_change + contacts.along(gain),
        plus_change + contacts.along(rebound),
    )


@eqx.filter_custom_jvp
def at_rest_on_stops(
    machine: Machine,
    phase: Float[Array, "2 harmonics ..."],
    stuck: Bool[Array, "stops ..."],
    x: Float[Array, "n ..."],
    gap: Float[Array, "stops ..."],
) -> tuple[Float[Array, "n ..."], Float[Array, "stops ..."]]:
    """Positions and gaps, of masses that come to rest those of their stops: they have no part of the delay of an impact."""
    del machine, phase, stuck
    return x, gap


@at_rest_on_stops.def_jvp
def _at_rest_on_stops_jvp(primals, tangents):
    def closed(machine: Machine, phase: Array, stuck: Array, x: Array, gap: Array) -> tuple[Array, Array]:
        return machine.contacts.with_closed_gaps(x, stuck, phase), jnp.where(stuck, 0, gap)

    return at_rest_on_stops(*primals), eqx.filter_jvp(closed, primals, tangents)[1]


@eqx.filter_custom_jvp
def contacts_at_own_times(
    machine: Machine,
    before: State,
    hit: Bool[Array, "stops ..."],
    closed: Bool[Array, "stops ..."],
    x: Float[Array, "n ..."],
    v: Float[Array, "n ..."],
    gap: Float[Array, "stops ..."],
    minus: Float[Array, "stops ..."],
    plus: Float[Array, "stops ..."],
    impulse: Float[Array, "stops ..."],
) -> AfterImpacts:
    """`at_own_times` of contacts in general, with all gaps and impulses; `closed` are contacts that stay closed in the impacts."""
    del machine, before, hit, closed
    return x, v, gap, minus, plus, impulse


@contacts_at_own_times.def_jvp
def _contacts_at_own_times_jvp(primals, tangents):
    machine, before, hit, closed, _, v, gap, *_ = primals
    found = contacts_at_own_times(*primals)
    changes, gap_change = _changes(found, tangents)
    if gap_change is None:
        return found, tuple(changes)
    x_change, v_change, change, minus_change, plus_change, impulse_change = changes
    contacts, phase_rate = machine.contacts, machine.phase_rate(before.phase)
    speed, plus = contacts.speeds(before.v, phase_rate), contacts.speeds(v, phase_rate)
    # Row k of `near` has the contacts that k pushes.
    near = (contacts.compliance != 0) & ~jnp.eye(contacts.num, dtype=bool).reshape(
        contacts.num, contacts.num, *[1] * (gap.ndim - 1)
    )
    law = _slope_of_law(machine, speed)
    share = _shares_of_one_impact(contacts, hit, speed)
    follows = jnp.any(share != 0, axis=0)
    apart = near & (share == 0) & (jnp.swapaxes(share, 0, 1) == 0)
    alone = hit & ~follows & ~jnp.any(apart & (hit | closed)[None], axis=1)
    delay = jnp.where(alone, gap_change / jnp.where(alone, speed, 1), 0)
    # Changes of the velocities for which the speed of approach to a contact grows by 1.
    unit = contacts.unit_changes()
    slopes, rises = _slopes(machine, before, unit, jnp.where(alone, plus - speed, 0), law, alone)
    way = jnp.sum(unit * (plus * delay)[:, None], axis=0)
    gain = jnp.sum(slopes * delay[:, None], axis=0)
    rise = jnp.sum(rises * delay[:, None], axis=0)
    borne, rebound = (1 + law) * rise * contacts.effective_mass, -law * rise
    rise, rebound = (a + jnp.sum(share * a[:, None], axis=0) for a in (rise, rebound))
    return found, (
        x_change - way,
        v_change + gain,
        change + jnp.where(closed, 0, contacts.along(way)),
        minus_change + rise,
        plus_change + rebound,
        impulse_change + borne,
    )


@eqx.filter_custom_jvp
def not_differentiable(
    where: Bool[Array, "..."], x: Float[Array, "n ..."], v: Float[Array, "n ..."]
) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
    """Positions and velocities, whose derivatives are NaN `where` they are not known."""
    del where
    return x, v


@not_differentiable.def_jvp
def _not_differentiable_jvp(primals, tangents):
    where, x, v = primals
    # A factor, as rules of differentiation must be linear.
    factor = jnp.where(where, jnp.nan, 1).astype(x.dtype)
    changes = tuple(
        jnp.zeros_like(a) if t is None else t * factor for a, t in zip((x, v), tangents[1:], strict=True)
    )
    return (x, v), changes


def _changes(found: tuple[Array, ...], tangents: Sequence) -> tuple[list[Array], Array | None]:
    """Derivatives of what is handed in, zero where there are none, and those of the gaps before the impacts."""
    before = tangents[1]
    given = tangents[-len(found) :]
    changes = [jnp.zeros_like(a) if t is None else t for a, t in zip(found, given, strict=True)]
    return changes, None if before is None else before.gap


def _shares_of_one_impact(
    contacts: Contacts, hit: Bool[Array, "stops ..."], speed: Array
) -> Float[Array, "stops stops ..."]:
    """Speeds of the contacts hit per speed of one of the same row and place, in the row of that, which is the one that rebounds most.

    A stop that is there twice is hit once: at the time of that one. Zero for all others.
    """
    own = jnp.sqrt(contacts.effective_mass)
    cosine = contacts.compliance * own[:, None] * own[None]
    is_one = hit[:, None] & hit[None] & (jnp.abs(cosine - 1) <= 64 * float(jnp.finfo(speed.dtype).eps))
    is_one = is_one & jnp.isclose((speed * own)[:, None], (speed * own)[None], rtol=1e-9, atol=0)
    rebound = jnp.where(hit, -contacts.restitution_at(speed), 0)
    number = jnp.arange(contacts.num).reshape(-1, *[1] * (speed.ndim - 1))
    is_first = (rebound[:, None] < rebound[None]) | (
        (rebound[:, None] == rebound[None]) & (number[:, None] < number[None])
    )
    leads = is_one & is_first
    leads = leads & ~jnp.any(leads, axis=0)[:, None]
    return jnp.where(leads, own[:, None] / own[None], 0)


def _slope_of_law(machine: Machine, speed: Array) -> Array:
    """Derivative of the speed at which each contact is left by that at which it is hit."""
    law = lambda u: machine.contacts.restitution_at(u) * u  # noqa: E731
    return jax.jvp(law, (speed,), (jnp.ones_like(speed),))[1]


def _slopes(
    machine: Machine, before: State, unit: Array, rise: Array, law: Array, alone: Array
) -> tuple[Array, Array]:
    """Changes for a delay of each contact by 1, (contacts, ...).

    Of the velocities after the impacts, (contacts, n, ...), and of the speeds of approach to what is hit, (contacts, contacts, ...).
    """
    contacts, hold = machine.contacts, machine.hold(before.held)
    gains = unit * rise[:, None]
    whole = jnp.sum(gains, axis=0)

    def acceleration(v: Array) -> Array:
        state = eqx.tree_at(lambda s: s.v, before, v)
        if state.mode is not None:
            direction, way = before.mode.direction, jnp.sign(sliding_velocity(machine, state))
            # Friction turns with the velocity, and the slider of a Jenkins element stops.
            slides = (direction != 0) & (~contacts.are(JENKINS) | (way == direction))
            direction = jnp.where(slides, way, 0).astype(jnp.int8)
            state = eqx.tree_at(lambda s: s.mode.direction, state, direction)
        own = machine.in_mode(state)
        return own.contacts.accelerations(own.total_force(state), hold, before.phase)

    def of_contact(number: Array, gain: Array) -> tuple[Array, Array]:
        base = before.v + (whole - gain) / 2  # of the others that hit: half before, half after
        ahead = acceleration(base)
        loss = ahead - acceleration(base + gain)
        is_own = (jnp.arange(contacts.num) == number).reshape(-1, *[1] * (law.ndim - 1))
        risen = jnp.where(is_own, contacts.accelerated_towards(ahead, before.phase), contacts.along(loss) / 2)
        risen = jnp.where(alone, risen, 0)
        return loss - jnp.sum(unit * ((1 + law) * risen)[:, None], axis=0), risen

    return jax.vmap(of_contact)(jnp.arange(contacts.num), gains)
