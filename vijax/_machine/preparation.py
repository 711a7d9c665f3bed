"""Machine of the engine from its numbers, for a span of time, and the bound on its steps."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._jax.arrays import (
    Reals,
    Scalar,
)
from .._system.waves import Waves
from .contacts import Contacts
from .extra_force import ExtraForce
from .frame import Frame
from .machine import Machine
from .numbers import MachineNumbers
from .rate_bounds import of_unit_mass, rate_of_motion, rate_with_closed
from .stops import Stops
from .switching import SwitchingContacts
from .tables import Tables, prepare_tables
from .turns import Turns


def prepare(
    numbers: MachineNumbers,
    span: Scalar,
    start: tuple[Scalar, Float[Array, "n ..."], Float[Array, "n ..."]],
    *,
    can_stick: bool,
) -> Machine:
    """Prepare a machine for the engine.

    Args:
        numbers: numbers of the machine; leaves may have lanes as last axis.
        span: duration of the simulation.
        start: initial time, positions and velocities.
        can_stick: whether any stop may hold its mass.
    """
    rows = numbers.rows  # concrete rows stay NumPy arrays, see `Stops`
    numbers = jax.tree.map(lambda a: jnp.asarray(a) if isinstance(a, np.ndarray) else a, numbers)
    waves, frequency, frame, walls = numbers.waves, numbers.frequency, None, None
    has_full_mass = numbers.mass.ndim == numbers.stiffness.ndim
    unit = of_unit_mass(numbers) if has_full_mass else None
    inverse_mass = 1 / numbers.mass if unit is None else unit.inverse_mass
    if numbers.signs is not None:
        walls = numbers.travel
    elif numbers.travel is not None:
        frame = Frame(numbers.travel, frequency)
        waves = jax.tree.map(jnp.add, waves, frame.load(numbers.mass, numbers.damping, numbers.stiffness))
    is_driven = frequency > 0
    longest = jnp.asarray(jnp.finfo(numbers.mass.dtype).max ** 0.5, numbers.mass.dtype)
    period = jnp.where(is_driven, 2 * jnp.pi / jnp.where(is_driven, frequency, 1.0), longest)
    tones = numbers.tones
    rate = jnp.maximum(rate_of_motion(numbers, unit), _fastest(numbers))
    extra = None
    if numbers.force is not None:
        extra = ExtraForce(numbers.force, start[0], frame)
        rate = rate + extra.rate(*start, numbers.mass)
    rate = jnp.maximum(rate, 1 / span)
    contacts = _contacts(numbers, rows, inverse_mass, walls)
    return Machine(
        damping=numbers.damping,
        stiffness=numbers.stiffness,
        mean=numbers.mean,
        waves=waves,
        frequency=frequency,
        period=period,
        contacts=contacts,
        rate=rate,
        timescale=1 / rate,
        can_stick=can_stick,
        extra=extra,
        frame=frame,
        closed_rate=rate_with_closed(numbers, contacts, rate)
        if isinstance(contacts, SwitchingContacts)
        else None,
        num_states=numbers.num_states,
        tables=_tables(numbers, start[0], frequency),
        base=numbers.base,
        tones=tones,
        turns=None if tones is None else Turns.of(tones.frequencies, frequency),
    )


def _fastest(numbers: MachineNumbers) -> Scalar:
    """Highest angular frequency of load and moving stops."""
    if numbers.tones is None:
        return numbers.highest * numbers.frequency
    return jnp.max(numbers.highest * numbers.tones.frequencies, axis=0)


def _tables(numbers: MachineNumbers, t0: Scalar, frequency: Scalar) -> Tables | None:
    if numbers.tables is None:
        return None
    return prepare_tables(numbers.tables, t0, frequency, numbers.waves.num_harmonics)


def _contacts(numbers: MachineNumbers, rows: Reals, inverse_mass: Array, walls: Waves | None) -> Contacts:
    if numbers.signs is None:
        return Stops(rows, numbers.limit, numbers.restitution, inverse_mass)
    own = (
        numbers.rows,
        numbers.limit,
        numbers.restitution,
        inverse_mass,
        numbers.signs,
        walls,
        numbers.frequency,
    )
    return Contacts(*own) if numbers.laws is None else SwitchingContacts(*own, numbers.laws)


# Value of `max_steps` that stands for `default_max_steps`, a bound by the rate of the machine.
AUTOMATIC_MAX_STEPS = -1


def default_max_steps(machine: Machine, span: Scalar, least: Scalar | int = 100_000) -> Int[Array, "..."]:
    """Bound far above the steps of a sound motion over a span of time: 100 per unit of span * rate, plus `least`."""
    steps = 100 * span * machine.rate
    # A machine whose rate is not finite ends at its first step, and the bound must allow that step.
    total = least + jnp.where(jnp.isfinite(steps), steps, 0)
    return jnp.minimum(total, 2e9).astype(int)  # fits 32 bits
