"""The motion between events of a machine with proportional damping, exact, mode by mode.

A faster way than `TaylorFlow` where the damping is diagonal in the modes: every mode is then
q'' + 2 a q' + w^2 q = load, and with b = w^2 - a^2 of either sign its free motion is made of

    c(t) = cos(sqrt(b) t),  s(t) = sin(sqrt(b) t) / sqrt(b),

entire functions of b, so that under-, over- and critically damped modes are one formula. They are
summed as short power series of b t^2 (a step is never long against the motion), which vectorise, where
library sines do not, and give the increments c - 1 and exp(-a t) - 1 to full relative accuracy.

Every set of held masses has modes of its own, made once, before the loop, from concrete values.
`modal_flow` returns None where this way would lose digits or does not apply: traced values, damping that
the modes do not diagonalise, a mode without stiffness or at resonance without damping, more
than 8 sets of held masses. `TaylorFlow` takes those.
"""

from itertools import combinations
from math import factorial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._machine import Machine, State
from .._system.system import ImpactSystem
from .._types import Scalar, concrete, lift, matvec
from .._xla import compute_once
from .flow import AbstractFlow, Derivatives, Expansion

_TRUST_AND_TERMS = {"float64": (1.5, 11), "float32": (1.0, 6)}
_MAX_SETS = 8


class ModalFlow(AbstractFlow):
    """Exact motion of a linear machine with proportional damping. Made by `modal_flow`.

    Every array has the sets of held masses as its first axis and lanes as its last.
    """

    squared_frequency: Float[Array, "sets modes ..."]
    decay: Float[Array, "sets modes ..."]
    shape: Float[Array, "sets n modes ..."]
    inverse: Float[Array, "sets modes n ..."]
    offset: Float[Array, "sets n ..."]
    anchor: Float[Array, "sets n n ..."]
    cosine: Float[Array, "sets harmonics n ..."]
    sine: Float[Array, "sets harmonics n ..."]
    sets: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    def expand(self, machine: Machine, state: State, is_held: Bool[Array, "n ..."]) -> "ModalExpansion":
        """Expand the motion at `state` with the masses `is_held` at rest."""
        trust, _ = _TRUST_AND_TERMS[str(state.x.dtype)]
        w2, a, shape, inverse, offset, anchor, cosine, sine = self._of_set(is_held)
        cos, sin = state.phase
        speed = lift(machine.harmonics, cos) * machine.frequency
        steady = offset + _over_harmonics(cosine, cos) + _over_harmonics(sine, sin)
        if len(self.sets) > 1:
            steady = steady + matvec(anchor, state.x)
        steady_v = _over_harmonics(sine, speed * cos) - _over_harmonics(cosine, speed * sin)
        force = machine.force(state.phase, state.x, state.v)
        response = jnp.where(is_held, 0, machine.inverse_mass)
        acceleration = response * force
        force_rate = machine.force_rate(state.phase, state.v, acceleration)
        jerk = response * force_rate
        turn2 = machine.phase_rate(machine.phase_rate(state.phase))
        curvature = (
            machine.oscillating_load(turn2)
            - matvec(machine.damping, jerk)
            - matvec(machine.stiffness, acceleration)
        )
        return ModalExpansion(
            machine=machine,
            state=state,
            squared_frequency=w2,
            decay=a,
            shape=shape,
            q=matvec(inverse, state.x - steady),
            q_rate=matvec(inverse, state.v - steady_v),
            cosine=cosine,
            sine=sine,
            now=Derivatives(acceleration, jerk, force, force_rate, curvature),
            limit=trust / machine.rate,
        )

    def _of_set(self, is_held: Bool[Array, "n ..."]) -> tuple[Array, ...]:
        """The tables of the masses held now: a chain of selections, cheaper than a gather."""
        tables = (
            self.squared_frequency,
            self.decay,
            self.shape,
            self.inverse,
            self.offset,
            self.anchor,
            self.cosine,
            self.sine,
        )
        chosen = tuple(table[0] for table in tables)
        for k, held in enumerate(self.sets[1:], 1):
            is_this = jnp.ones(is_held.shape[1:], bool)
            for i in sorted(set().union(*self.sets)):
                is_this = is_this & (is_held[i] if i in held else ~is_held[i])
            chosen = tuple(jnp.where(is_this, t[k], old) for t, old in zip(tables, chosen, strict=True))
        return chosen


class ModalExpansion(Expansion):
    """Modal coordinates of the free motion, and the steady response."""

    machine: Machine
    state: State
    squared_frequency: Float[Array, "modes ..."]
    decay: Float[Array, "modes ..."]
    shape: Float[Array, "n modes ..."]
    q: Float[Array, "modes ..."]
    q_rate: Float[Array, "modes ..."]
    cosine: Float[Array, "harmonics n ..."]
    sine: Float[Array, "harmonics n ..."]
    now: Derivatives
    limit: Scalar

    def rest(self, limit: Scalar) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."]]:
        """Bound |x''''| / 24 and |force'''| / 6 for all later times.

        The energy q'^2 + w^2 q^2 of a mode never grows, and q''' and q'''' are linear in q and q'.
        """
        del limit
        w2, a = self.squared_frequency, self.decay
        w = jnp.sqrt(w2)
        energy = jnp.sqrt(self.q_rate**2 + w2 * self.q**2)
        third = energy * (jnp.abs(4 * a * a - w2) + 2 * a * w)
        fourth = energy * (w * jnp.abs(4 * a * a - w2) + 4 * a * jnp.abs(w2 - 2 * a * a))
        shape = jnp.abs(self.shape)
        speed = lift(self.machine.harmonics, self.cosine[:, 0]) * self.machine.frequency
        size = jnp.abs(self.cosine) + jnp.abs(self.sine)
        x3 = matvec(shape, third) + jnp.sum(size * speed[:, None] ** 3, axis=0)
        x4 = matvec(shape, fourth) + jnp.sum(size * speed[:, None] ** 4, axis=0)
        load = jnp.abs(self.machine.cosine) + jnp.abs(self.machine.sine)
        load3 = jnp.sum(load * speed[:, None] ** 3, axis=0)
        force3 = (
            load3 + matvec(jnp.abs(self.machine.damping), x4) + matvec(jnp.abs(self.machine.stiffness), x3)
        )
        return x4 / 24, force3 / 6

    def move(
        self, step: Scalar
    ) -> tuple[Float[Array, "n ..."], Float[Array, "n ..."], Float[Array, "2 harmonics ..."]]:
        """Go `step` ahead in every mode and in the phase of the forcing."""
        cos, sin = self.state.phase
        speed = lift(self.machine.harmonics, cos) * self.machine.frequency
        fade, wave, arc, turn, slide = compute_once(
            self.machine.always, _factors, self.squared_frequency, self.decay, speed, step
        )
        # exp(-a t) (c + a s) - 1, exp(-a t) s: the increment of q, and of q' likewise.
        a, w2 = self.decay, self.squared_frequency
        grow = fade + (1 + fade) * (wave + a * arc)
        reach = (1 + fade) * arc
        slow = fade + (1 + fade) * (wave - a * arc)
        dq = grow * self.q + reach * self.q_rate
        dq_rate = slow * self.q_rate - reach * w2 * self.q
        dcos, dsin = turn * cos - slide * sin, turn * sin + slide * cos
        displacement = (
            matvec(self.shape, dq) + _over_harmonics(self.cosine, dcos) + _over_harmonics(self.sine, dsin)
        )
        gained = (
            matvec(self.shape, dq_rate)
            + _over_harmonics(self.sine, speed * dcos)
            - _over_harmonics(self.cosine, speed * dsin)
        )
        phase = jnp.stack(jnp.broadcast_arrays(cos + dcos, sin + dsin))
        return displacement, self.state.v + gained, phase


def _factors(w2: Array, a: Array, speed: Array, step: Scalar) -> tuple[Array, ...]:
    """exp(-a t) - 1, c - 1 and s of every mode; cos - 1 and sin of every harmonic."""
    terms = _TRUST_AND_TERMS[str(step.dtype)][1]
    wave, arc = _cosine_and_sine((w2 - a * a) * step * step, terms)
    turn, slide = _cosine_and_sine(speed * speed * step * step, terms)
    fade = _expm1(-a * step, terms)
    return fade, wave, arc * step, turn, slide * speed * step


def _cosine_and_sine(z: Array, terms: int) -> tuple[Array, Array]:
    """cos(y) - 1 and sin(y) / y as series of z = y^2, which may be negative."""
    cosine = [(-1) ** k / factorial(2 * k) for k in range(1, terms)]
    sine = [(-1) ** k / factorial(2 * k + 1) for k in range(terms)]
    return z * _polynomial(cosine, z), _polynomial(sine, z)


def _expm1(y: Array, terms: int) -> Array:
    """exp(y) - 1 for |y| up to the trust: the series at y / 4, doubled twice."""
    part = y / 4
    value = part * _polynomial([1 / factorial(k) for k in range(1, terms + 1)], part)
    value = value * (2 + value)
    return value * (2 + value)


def _polynomial(coefficients: list[float], z: Array) -> Array:
    total = jnp.full_like(z, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * z + c
    return total


def _over_harmonics(
    of_harmonic: Float[Array, "harmonics n ..."], wave: Float[Array, "harmonics ..."]
) -> Array:
    total = of_harmonic[0] * wave[0]
    for h in range(1, of_harmonic.shape[0]):
        total = total + of_harmonic[h] * wave[h]
    return total


def modal_flow(system: ImpactSystem, *, can_stick: bool) -> ModalFlow | None:
    """Tabulate the modes of every set of held masses, or return None where they do not serve.

    Args:
        system: the machine; its leaves may carry lanes as their last axis.
        can_stick: whether any stop might hold its mass.

    Returns:
        The flow, or None.
    """
    dtype = system.mass.dtype
    leaves = [concrete(leaf) for leaf in jax.tree.leaves(system)]
    holdable = sorted({stop.mass for stop in system.stops}) if can_stick else []
    if any(leaf is None for leaf in leaves) or 2 ** len(holdable) > _MAX_SETS:
        return None
    system = jax.tree.unflatten(jax.tree.structure(system), leaves)
    sets = tuple(s for k in range(len(holdable) + 1) for s in combinations(holdable, k))
    has_lanes = system.mass.ndim == 2
    if not has_lanes:
        system = jax.tree.map(lambda leaf: leaf[..., None], system)
    tables = []
    for held in sets:
        table = _modes_of_set(system, held)
        if table is None:
            return None
        tables.append(table)
    arrays = [np.moveaxis(np.stack(column), 1, -1) for column in zip(*tables, strict=True)]
    if not has_lanes:
        arrays = [a[..., 0] for a in arrays]
    return ModalFlow(*(jnp.asarray(a, dtype) for a in arrays), sets=sets)


def _modes_of_set(system: ImpactSystem, held: tuple[int, ...]) -> tuple[np.ndarray, ...] | None:
    """Modes and steady response with the masses `held` at rest, lanes first; None where digits would go."""
    mass, damping, stiffness = (_lanes_first(a) for a in (system.mass, system.damping, system.stiffness))
    n = mass.shape[1]
    free = [i for i in range(n) if i not in held]
    root = np.sqrt(mass[:, free])
    scale = root[:, :, None] * root[:, None]
    w2, vectors = np.linalg.eigh(stiffness[np.ix_(range(len(stiffness)), free, free)] / scale)
    modal_damping = (
        np.swapaxes(vectors, 1, 2) @ (damping[np.ix_(range(len(damping)), free, free)] / scale) @ vectors
    )
    decay = np.diagonal(modal_damping, axis1=1, axis2=2) / 2
    between = np.abs(modal_damping - np.eye(len(free)) * modal_damping)
    eps = np.finfo(mass.dtype).eps
    if free and (between > 64 * eps * np.abs(modal_damping).max()).any():
        return None
    if (w2 <= 1e-6 * np.abs(w2).max(initial=0.0)).any():
        return None
    lanes = max(len(w2), len(mass))
    shape, inverse = np.zeros((lanes, n, n)), np.zeros((lanes, n, n))
    modes = range(len(free))
    shape[np.ix_(range(lanes), free, modes)] = vectors / root[:, :, None]
    inverse[np.ix_(range(lanes), modes, free)] = np.swapaxes(vectors * root[:, :, None], 1, 2)
    pad = ((0, 0), (0, n - len(free)))
    w2, decay = np.pad(w2, pad, constant_values=1.0), np.pad(decay, pad)
    steady = _steady_response(system, shape, w2, decay, len(free))
    if steady is None:
        return None
    flexibility = shape / w2[:, None] @ np.swapaxes(shape, 1, 2)
    offset = (flexibility @ _lanes_first(system.forcing.mean)[..., None])[..., 0]
    anchor = np.zeros((lanes, n, n))
    for i in held:
        anchor[:, :, i] = -(flexibility @ stiffness[:, :, i, None])[..., 0]
        anchor[:, i, i] = 1.0
    return w2, decay, shape, inverse, offset, anchor, *steady


def _steady_response(
    system: ImpactSystem, shape: np.ndarray, w2: np.ndarray, decay: np.ndarray, num_modes: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Amplitudes of the cosines and sines of every harmonic; None near undamped resonance."""
    forcing = system.forcing
    amplitude, phase = (a if a.ndim == 3 else a[None] for a in (forcing.amplitude, forcing.phase))
    load = _lanes_first(amplitude * np.exp(1j * np.asarray(phase)))
    speed = np.arange(1, load.shape[1] + 1) * np.atleast_1d(forcing.frequency)[:, None]
    impedance = w2[:, None] - speed[..., None] ** 2 + 2j * decay[:, None] * speed[..., None]
    impedance[..., num_modes:] = np.inf  # what fills the table up is no mode
    if (np.abs(impedance) <= 1e-2 * (w2[:, None] + speed[..., None] ** 2)).any():
        return None
    response = np.einsum("lij,lkj->lki", shape, np.einsum("lij,lki->lkj", shape, load) / impedance)
    return response.real, -response.imag


def _lanes_first(array: Array | np.ndarray) -> np.ndarray:
    return np.moveaxis(np.asarray(array), -1, 0)
