"""Schemes of machines: an `ImpactSystem`, or the machine of a trajectory."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._jax.arrays import Reals
from ..._machine.contacts import Contacts
from ..._machine.kinds import COMPLIANT
from ..._machine.machine import Machine
from ..._machine.numbers import BaseLoad, base_of, harmonic_load_of, tones_of
from ..._machine.switching import SwitchingContacts
from ..._system.compliant import CompliantContact, CompliantStop
from ..._system.contact import whole_row
from ..._system.force import name_of_force, whole_force
from ..._system.forcing import Harmonic
from ..._system.hysteresis import ForceBesideSliders
from ..._system.parts import AnyStop
from ..._system.restitution import (
    AbstractRestitution,
    Restitution,
    light_coefficient,
    restitution_of_contacts,
)
from ..._system.system import ImpactSystem
from ..._system.waves import Tones, Waves
from ..._trajectory.solution import Solution
from ...models._nonlinear import PendulumWeight
from ...plot._contacts import masses_of_stops
from .scheme import NOTHING, Rubbing, Scheme, formula, harmonic_terms


def scheme_of_system(system: ImpactSystem) -> Scheme:
    """Scheme of one machine; raise for a batch."""
    if system.stiffness.ndim != 2:
        raise ValueError(
            f"Machines are drawn one by one, but this is a batch of shape {system.stiffness.shape[2:]}: draw its parts."
        )
    n, (mean, whole) = system.num_masses, jax.tree.map(np.asarray, harmonic_load_of(system))
    of_base = jax.tree.map(np.asarray, base_of(system))
    waves, speeds = (
        jax.tree.map(np.subtract, whole, of_base.waves),
        _speeds(whole, system.forcing.clock, tones_of(system)),
    )
    rows = np.array([whole_row(stop.coefficients, n) for stop in system.stops]).reshape(-1, n)
    moving = [stop.motion is not None and bool(np.any(stop.motion.amplitude)) for stop in system.stops]
    (stiffness, damping), omitted = _drawn(
        np.asarray(system.stiffness), np.asarray(system.damping), system.num_states, len(system.hysteresis)
    )
    return Scheme(
        stiffness,
        damping,
        mean,
        waves=waves,
        frequency=float(system.forcing.clock),
        speeds=speeds,
        rows=rows,
        masses=masses_of_stops(system),
        limit=np.array([float(stop.sign * stop.centre) for stop in system.stops]),
        restitution=tuple(map(_law_in_words, system.stops)),
        is_moving=np.array(moving, bool),
        is_lumped=not system.has_full_mass,
        force=None if system.force is None else _name(system.force),
        is_compliant=np.array([stop.is_compliant for stop in system.stops], bool),
        is_damped=np.array([bool(getattr(stop, "damping", 0) > 0) for stop in system.stops], bool),
        is_preloaded=np.array([bool(getattr(stop, "preload", 0) > 0) for stop in system.stops], bool),
        friction=tuple(
            Rubbing(whole_row(one.coefficients, n), float(one.slip), float(one.velocity), one.contact)
            for one in system.friction
        ),
        omitted=omitted,
        accelerations=_accelerations(np.asarray(system.mass), mean),
        is_hung=isinstance(system.force, PendulumWeight),
        largest_of_tables=_largest_of_tables(system),
        base=_base_in_words(np.asarray(system.mass), of_base, speeds),
    )


def _largest_of_tables(system: ImpactSystem) -> np.ndarray | None:
    tables = [load for load in system.forcing.loads if not isinstance(load, Harmonic) and not load.from_base]
    return np.sum([np.asarray(load.size()) for load in tables], axis=0) if tables else None


def _base_in_words(mass: np.ndarray, of_base: BaseLoad, speeds: np.ndarray) -> str:
    """Acceleration of a base that moves, as a formula; empty for none."""
    cosines, sines = (-_accelerations(mass, a.T)[0] for a in (of_base.waves.cosine, of_base.waves.sine))
    terms = harmonic_terms(speeds, cosines, sines, NOTHING * np.max(np.abs([cosines, sines]), initial=0.0))
    terms += ["+ a(t)"] if any(of_base.tables) else []
    return formula(terms) if terms else ""


def _accelerations(mass: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Accelerations by forces, (n, ...)."""
    return np.linalg.solve(mass, forces) if mass.ndim == 2 else (forces[: len(mass)].T / mass).T


def _law_in_words(stop: AnyStop) -> str:
    if isinstance(stop, CompliantStop | CompliantContact):
        return _cushion_in_words(float(stop.stiffness), float(stop.damping), float(stop.preload))
    (words,) = _coefficients(restitution_of_contacts([stop.restitution], np.zeros(())))
    return words


def _cushion_in_words(stiffness: float, damping: float, preload: float) -> str:
    """Stiffness, and damping and preload where there are any, in a line each."""
    parts = {"k": stiffness} | {name: a for name, a in (("c", damping), ("N_0", preload)) if a > 0}
    return "\n".join(f"${name}$ = {a:.3g}" for name, a in parts.items())


def _coefficients(restitution: Restitution) -> tuple[str, ...]:
    symbol = "r(0)" if isinstance(restitution, AbstractRestitution) else "r"
    return tuple(f"${symbol}$ = {r:.3g}" for r in np.asarray(light_coefficient(restitution)))


def scheme_of_solution(sol: Solution, places: np.ndarray) -> Scheme:
    """Scheme of the machine of a trajectory; `places` are the positions of its stops, (times, stops)."""
    machine = sol.machine
    base: BaseLoad | None = jax.tree.map(np.asarray, sol.base)
    contacts, n = machine.contacts, sol.x1.shape[-1]
    inverse_mass = np.asarray(machine.inverse_mass)
    inverse, mean = inverse_mass[:n], np.asarray(machine.mean)[:n]
    inverse = inverse if inverse.ndim == 1 else inverse[:, :n]
    (stiffness, damping), omitted = _drawn(
        np.asarray(machine.stiffness)[:n, :n],
        np.asarray(machine.damping)[:n, :n],
        machine.num_states - sol.num_sliders,
        sol.num_sliders,
    )
    rows, num_stops = (
        np.asarray(contacts.rows).reshape(contacts.num, len(inverse_mass))[:, :n],
        contacts.num_stops,
    )
    switching = _switching_of(contacts, rows, contacts.num - sol.num_sliders)
    speeds = _speeds(machine.waves, machine.frequency, machine.tones)
    largest, of_tables = _loads_by_tables(machine, base)
    force = None if machine.extra is None else machine.extra.force
    force = force.force if isinstance(force, ForceBesideSliders) else force
    return Scheme(
        stiffness,
        damping,
        mean,
        waves=jax.tree.map(lambda a: a[:, :n], _load_in_space(machine, base)),
        frequency=float(machine.frequency),
        speeds=speeds,
        rows=rows[:num_stops],
        masses=contacts.masses[:num_stops],
        limit=np.asarray(contacts.limit)[:num_stops],
        restitution=switching.words,
        is_moving=np.ptp(places, axis=0) > 0,
        is_lumped=machine.inverse_mass.ndim == 1,
        force=None if force is None else _name(force),
        is_compliant=switching.is_compliant,
        is_damped=switching.is_damped,
        is_preloaded=switching.is_preloaded,
        friction=switching.friction,
        omitted=omitted,
        accelerations=inverse @ mean if inverse.ndim == 2 else inverse * mean[: len(inverse)],
        is_hung=force is not None and isinstance(whole_force(force.force), PendulumWeight),
        largest_of_tables=largest,
        of_tables=of_tables,
        base="" if base is None else _base_in_words(_mass(inverse), base, speeds),
    )


def _drawn(
    stiffness: np.ndarray, damping: np.ndarray, num_states: int, num_sliders: int
) -> tuple[list[np.ndarray], str]:
    """Symmetric parts of the matrices, without the states, and what they lack in words."""
    first = len(stiffness) - num_states
    is_mass = np.arange(len(stiffness)) < first
    between = [np.where(np.outer(is_mass, is_mass), a, 0) for a in (stiffness, damping)]
    names = [
        f"asymmetric part of the {name}"
        for name, a in zip(("stiffness", "damping"), between, strict=True)
        if np.abs(a - a.T).max() > NOTHING * np.abs(a).max()
    ]
    if num_states:
        names.append(
            "links of the last box, a state"
            if num_states == 1
            else f"links of the last {num_states} boxes, states"
        )
    if num_sliders:
        names.append("one Jenkins element" if num_sliders == 1 else f"{num_sliders} Jenkins elements")
    return [(a + a.T) / 2 for a in between], f"not drawn: {', '.join(names)}" if names else ""


def _speeds(waves: Waves, frequency: Reals, tones: Tones | None) -> np.ndarray:
    """Angular frequencies of the harmonics of a load, (harmonics,)."""
    return np.asarray(waves.speeds(frequency if tones is None else tones))[:, 0]


class _Switching(NamedTuple):
    """Laws of contacts and friction elements, as fields of a scheme."""

    words: tuple[str, ...]
    is_compliant: np.ndarray
    is_damped: np.ndarray
    is_preloaded: np.ndarray
    friction: tuple[Rubbing, ...] = ()


def _switching_of(contacts: Contacts, rows: np.ndarray, num_limits: int) -> _Switching:
    """Laws of the contacts and the friction elements, the first `num_limits` rows."""
    num_stops, words = contacts.num_stops, _coefficients(contacts.restitution)
    if not isinstance(contacts, SwitchingContacts):
        none = np.zeros(num_stops, bool)
        return _Switching(words, none, none, none)
    laws, is_compliant = contacts.laws, np.array(contacts.laws.kinds[:num_stops]) == COMPLIANT
    force, velocity = (np.asarray(a) for a in (laws.force, laws.velocity))
    cushions = np.stack([laws.stiffness, laws.damping, laws.preload], axis=1)[:num_stops]
    words = tuple(
        _cushion_in_words(*cushions[j].tolist()) if is_compliant[j] else words[j] for j in range(num_stops)
    )
    normal = laws.normal or (-1,) * contacts.num
    force = force if laws.coefficient is None else force + np.asarray(laws.coefficient)
    friction = tuple(
        Rubbing(rows[j], float(force[j]), float(velocity[j]), None if normal[j] < 0 else normal[j])
        for j in range(num_stops, num_limits)
    )
    return _Switching(words, is_compliant, cushions[:, 1] > 0, cushions[:, 2] > 0, friction)


def _mass(inverse: np.ndarray) -> np.ndarray:
    """Mass matrix, or its diagonal, of the inverse."""
    return 1 / inverse if inverse.ndim == 1 else np.linalg.inv(inverse)


def _load_in_space(machine: Machine, base: BaseLoad | None) -> Waves:
    """Harmonics of the load in space, without that of a base that moves.

    A machine that moves with its stops (`frame`) has -M w'' - C w' - K w among its own.
    """
    waves, frame = jax.tree.map(np.asarray, machine.waves), machine.frame
    parts = [] if base is None else [base.waves]
    if frame is not None:
        parts.append(frame.load(1 / machine.inverse_mass, machine.damping, machine.stiffness))
    for part in parts:
        waves = jax.tree.map(lambda a, b: np.where(abs(a - b) > NOTHING * abs(b), a - b, 0.0), waves, part)
    return waves


def _loads_by_tables(
    machine: Machine, base: BaseLoad | None
) -> tuple[np.ndarray, Callable[[float], np.ndarray]] | tuple[None, None]:
    """Largest loads by tables, and these as a function of time, but those of a base that moves; None if there are none."""
    tables = machine.tables
    if tables is None:
        return None, None
    own = (True,) * len(tables.streams) if base is None else tuple(not one for one in base.tables)
    if not any(own):
        return None, None
    sizes = [one.bounds()[0] for one, is_own in zip(tables.streams, own, strict=True) if is_own]
    return np.sum(sizes, axis=0), lambda t: np.asarray(tables.load_of(tables.at(jnp.asarray(t)), own))


def _name(force: object) -> str:
    """The name of a force without its parameters."""
    return name_of_force(force).partition("(")[0].strip("<>")  # pyright: ignore[reportArgumentType]
