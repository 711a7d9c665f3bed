"""Symmetries of a machine: signed permutations of its coordinates that map motions to motions.

A symmetry takes a motion x(t) to y(t) = S x(t + s T) + d, with a signed permutation S, a share s of the forcing period T,
and an offset d. So y is a motion as well if

    S commutes with M, C and K;
    f(t) = S f(t + s T) + K d for the load, and likewise for `force`;
    S maps the rows of stops, contacts and friction elements to one another, with the same laws, and positions that differ
    by the offset along the row.

Signed permutations are found mass by mass: each choice is checked against those before, by the entries of the matrices and
by the load, so that a chain of any length takes no time. A share of the period follows from the order m of S: m times the
share is a period of the load. Loads and forces are compared at instants in no simple ratio to the period; a `force` also at
random states. (Rejected: rotations by any angle. Stops and contacts are half-planes, which few of them map to one another.)
"""

from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import compress
from math import gcd
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._jax.concrete import concrete, concrete_evaluation
from .contact import whole_row
from .force import BoundForce, bind_args, force_of
from .load_values import harmonics_of, load_at
from .symmetry import Symmetry, order_of

# share: numbers of a machine that differ by less are equal; values of a force, relative to the largest.
_EQUAL, _EQUAL_FORCE = 1e-12, 1e-9
# Most symmetries of a machine, and most choices that are tried for them.
_MOST, _MOST_TRIED = 500, 20_000
# Up to so many coordinates a signed permutation of any order is found.
_SMALL = 8
# Instants at which loads are compared, and instants and states for forces.
_INSTANTS, _STATES = 64, 24


def symmetries_of(system: Any, args: object = None) -> tuple[Symmetry, ...]:
    """Symmetries of a machine but the identity, see `ImpactSystem.symmetries`.

    Raises:
        ValueError: for traced numbers, or if there are too many.
    """
    leaves, structure = jax.tree.flatten(system)
    known = [concrete(leaf) for leaf in leaves]
    if any(leaf is None for leaf in known):
        raise ValueError(
            "Symmetries are those of known numbers: call `symmetries` outside of `jax.jit`, `jax.vmap` and derivatives."
        )
    with concrete_evaluation():
        # Loads are evaluated a dozen times: by NumPy, which takes half the time of all. A force may need JAX.
        own = [a if isinstance(leaf, jax.Array) else leaf for leaf, a in zip(leaves, known, strict=True)]
        machine = _Machine.of(
            jax.tree.unflatten(structure, own), bind_args(force_of(system), args, system.num_masses)
        )
        found = list(_symmetries(machine))
    return tuple(sorted(found, key=lambda one: (one.shift, one.order)))


class _Limit(NamedTuple):
    """A stop, contact or friction element.

    Attributes:
        kind: "rigid", "compliant", "friction" or "hysteresis". The laws of the last two are odd: row and place may change sign
            together.
        row: its row, (n,).
        place: position or, of friction, velocity along the row, at some instants.
        law: its other numbers, a pytree.
        contact: number of the stop that presses, of friction of contacts; None of all else.
    """

    kind: str
    row: np.ndarray
    place: Callable[[np.ndarray], np.ndarray]
    law: Any
    contact: int | None = None

    @property
    def is_odd(self) -> bool:
        return self.kind in ("friction", "hysteresis")

    def is_like(self, other: "_Limit") -> bool:
        """True if both have the same kind of law and its numbers."""
        ours, theirs = jax.tree.flatten(self.law), jax.tree.flatten(other.law)
        return self.kind == other.kind and ours[1] == theirs[1] and all(map(_is_equal, ours[0], theirs[0]))


class _Machine(NamedTuple):
    """Numbers of a machine that a symmetry must keep; instants are phases in forcing periods.

    Attributes:
        matrices: M, C and K, (3, n, n).
        is_state: flags of first-order states, (n,).
        load: load at some instants, (instants, n).
        common: the load repeats after 1 / `common` of the period; 0 if it is constant.
        limits: stops and contacts, then friction, then Jenkins elements.
        num_stops: number of stops and contacts.
        num_sliders: number of Jenkins elements.
        force: any other force, as a function of instants, positions and velocities; None if there is none.
    """

    matrices: np.ndarray
    is_state: np.ndarray
    load: Callable[[np.ndarray], np.ndarray]
    common: int
    limits: list[_Limit]
    num_stops: int
    num_sliders: int
    force: Callable | None

    @classmethod
    def of(cls, system: Any, force: BoundForce | None) -> "_Machine":
        mass = np.asarray(system.mass, float)
        matrices = np.stack(
            [np.diag(mass) if mass.ndim == 1 else mass, *map(np.asarray, (system.damping, system.stiffness))]
        )
        stops = [_limit_of(stop, system.num_masses) for stop in system.stops]
        rubbing = [_friction_of(one, system.num_masses) for one in system.friction]
        numbers = [harmonics_of(load) for load in system.forcing.loads]
        numbers += [harmonics_of(stop.motion) for stop in system.stops if stop.motion is not None]
        common = gcd(*(h for own in numbers for h in own))
        frequency = float(np.asarray(system.forcing.clock))
        is_periodic = frequency > 0 and not system.forcing.why_not_periodic
        return cls(
            matrices=matrices,
            is_state=system.is_state,
            load=lambda at: np.sum([load_at(load, at, frequency) for load in system.forcing.loads], axis=0),
            common=(common or (1 if force is not None else 0)) if is_periodic else 0,
            limits=stops + rubbing + [_slider_of(one, system.num_masses) for one in system.hysteresis],
            num_stops=len(stops),
            num_sliders=len(system.hysteresis),
            force=None if force is None else _force_at(force, frequency),
        )


def _limit_of(stop: Any, n: int) -> _Limit:
    row = whole_row(stop.coefficients, n)

    def place(at: np.ndarray) -> np.ndarray:
        moved = 0 * at if stop.motion is None else load_at(stop.motion, at, 1.0)[:, 0]
        return stop.sign * (float(stop.position) + moved)

    if stop.is_compliant:
        return _Limit("compliant", row, place, (stop.stiffness, stop.damping, stop.preload))
    return _Limit("rigid", row, place, stop.restitution)


def _friction_of(one: Any, n: int) -> _Limit:
    row, velocity = whole_row(one.coefficients, n), float(one.velocity)
    return _Limit("friction", row, lambda at: velocity + 0 * at, (one.slip, one.grip), one.contact)


def _slider_of(one: Any, n: int) -> _Limit:
    # Where it starts is no part of the machine, and its force depends on the motion of its row alone.
    return _Limit("hysteresis", whole_row(one.coefficients, n), lambda at: 0 * at, (one.stiffness, one.limit))


def _force_at(force: BoundForce, frequency: float) -> Callable:
    run = jax.vmap(force)
    period = 2 * np.pi / frequency if frequency > 0 else 0.0

    def at(instants: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.asarray(run(*map(jnp.asarray, (period * instants, x, v))))

    return at


def _symmetries(machine: _Machine) -> Iterator[Symmetry]:
    """All symmetries but the identity."""
    count = 0
    for matrix in _signed_permutations(machine):
        for shift in _shifts(machine, order_of(matrix)):
            is_identity = shift == 0 and np.array_equal(matrix, np.eye(len(matrix)))
            found = None if is_identity else _symmetry(machine, matrix, shift)
            if found is not None:
                count += 1
                _refuse_too_many(count, _MOST)
                yield found


def _refuse_too_many(count: int, most: int) -> None:
    if count > most:
        raise ValueError(
            "The machine has too many symmetries to list: masses without coupling, load and stops may move in any way. Leave them "
            "out, or couple them."
        )


def _shifts(machine: _Machine, order: int) -> list[Fraction]:
    """Shares of the period by which a symmetry of some order may shift."""
    parts = machine.common * order
    return [Fraction(k, parts) for k in range(parts)] if parts else [Fraction(0)]


def _signed_permutations(machine: _Machine) -> Iterator[np.ndarray]:
    """Signed permutations that commute with the matrices and allow some shift of the load."""
    matrices, n = machine.matrices, len(machine.is_state)
    scale = np.abs(matrices).max(axis=(1, 2), keepdims=True)
    scale = np.where(scale > 0, scale, 1)
    matrices, tried = matrices / scale, 0
    allowed = _allowed_by_load(machine)
    order = _connected_order(matrices)
    rows: list[tuple[int, int, int, frozenset]] = []

    def fits(i: int, j: int, sign: int) -> bool:
        if machine.is_state[i] != machine.is_state[j] or any(j == other for _, other, _, _ in rows):
            return False
        if not _is_near(matrices[:, i, i], matrices[:, j, j]):
            return False
        return all(
            _is_near(matrices[:, i, k], sign * s * matrices[:, j, m])
            and _is_near(matrices[:, k, i], sign * s * matrices[:, m, j])
            for k, m, s, _ in rows
        )

    def extended() -> Iterator[np.ndarray]:
        nonlocal tried
        if len(rows) == n:
            matrix = np.zeros((n, n))
            for i, j, sign, _ in rows:
                matrix[i, j] = sign
            yield matrix
            return
        i = order[len(rows)]
        before = rows[-1][3] if rows else None
        for j in range(n):
            for sign in (1, -1):
                tried += 1
                _refuse_too_many(tried, _MOST_TRIED)
                shifts = allowed(i, j, sign, before) if fits(i, j, sign) else None
                if shifts:
                    rows.append((i, j, sign, shifts))
                    yield from extended()
                    rows.pop()

    yield from extended()


def _connected_order(matrices: np.ndarray) -> list[int]:
    """Coordinates in an order in which each is coupled to one before, where it is coupled at all."""
    coupled = np.abs(matrices).max(axis=0) > 0
    coupled = coupled | coupled.T
    order: list[int] = []
    while len(order) < len(coupled):
        left = [i for i in range(len(coupled)) if i not in order]
        order.append(next((i for i in left if coupled[i, order].any()), left[0]))
    return order


def _allowed_by_load(machine: _Machine) -> Callable[[int, int, int, frozenset | None], frozenset]:
    """Function of a choice i -> sign j and of the shifts allowed before: those that its load allows as well."""
    n, instants = len(machine.is_state), _instants()
    # Of many coordinates only likely orders are tried: small ones, and those of a ring.
    parts = (*range(1, 2 * min(n, _SMALL) + 1), n, 2 * n) if machine.common else ()
    shifts = sorted(
        {Fraction(k, machine.common * m) for m in parts for k in range(machine.common * m)} or {Fraction(0)}
    )
    # All at once: one evaluation of a load takes as long as of a hundred instants.
    at = instants + np.array([0.0, *map(float, shifts)])[:, None]
    now, *later = machine.load(at.ravel()).reshape(*at.shape, n)
    tolerance, later = _EQUAL * max(1e-300, np.abs(now).max()), np.array(later)

    def allowing(i: int, j: int, sign: int) -> frozenset:
        spread = np.ptp(now[:, i] - sign * later[:, :, j], axis=1)
        return frozenset(compress(shifts, spread <= 1e3 * tolerance))

    known: dict[tuple[int, int, int], frozenset] = {}

    def allowed(i: int, j: int, sign: int, before: frozenset | None) -> frozenset:
        if (i, j, sign) not in known:
            known[i, j, sign] = allowing(i, j, sign)
        own = known[i, j, sign]
        return own if before is None else own & before

    return allowed


def _instants() -> np.ndarray:
    """Instants within a period, in no simple ratio to it."""
    return (np.arange(_INSTANTS) * (np.sqrt(5) - 1) / 2 + 0.1234) % 1


def _symmetry(machine: _Machine, matrix: np.ndarray, shift: Fraction) -> Symmetry | None:
    """The symmetry of a signed permutation and a shift; None if it is none."""
    pairs = _pairs(machine, matrix, float(shift))
    if pairs is None:
        return None
    offset = _offset(machine, matrix, float(shift), pairs)
    if offset is None or not _keeps_force(machine, matrix, float(shift), offset):
        return None
    first, last = machine.num_stops, len(pairs) - machine.num_sliders
    stops = tuple(k for k, _ in pairs[:first])
    rubbing = tuple(k - first for k, _ in pairs[first:last])
    stretches = np.zeros((machine.num_sliders, machine.num_sliders))
    for j, (k, sign) in enumerate(pairs[last:]):
        stretches[j, k - last] = sign
    return Symmetry(matrix, shift, offset, stops, rubbing, stretches)


def _pairs(machine: _Machine, matrix: np.ndarray, shift: float) -> list[tuple[int, int]] | None:
    """For each limit its partner and the sign of the row; None if one has none.

    Limits of one row are paired in the order of their places, as all are moved alike; friction of contacts after those, as its
    partner is pressed by the partner of its contact.
    """
    limits, instants = machine.limits, _instants()
    taken: list[int] = []
    found: dict[int, tuple[int, int]] = {}
    places = [float(np.mean(one.place(instants))) for one in limits]
    for j in sorted(range(len(limits)), key=lambda j: (limits[j].contact is not None, places[j])):
        options, contact = [], limits[j].contact
        pressing = None if contact is None else found[contact][0]
        for k, other in enumerate(limits):
            if other.contact != pressing:
                continue
            for sign in (1, -1) if other.is_odd else (1,):
                is_row = _is_near(limits[j].row @ matrix, sign * other.row)
                if k not in taken and is_row and limits[j].is_like(other):
                    options.append((sign * float(np.mean(other.place(instants + shift))), k, sign))
        if not options:
            return None
        _, k, sign = min(options)
        taken.append(k)
        found[j] = k, sign
    return [found[j] for j in range(len(limits))]


def _offset(
    machine: _Machine, matrix: np.ndarray, shift: float, pairs: list[tuple[int, int]]
) -> np.ndarray | None:
    """The offset that load, stops and friction need; None if there is none."""
    instants, stiffness = _instants(), machine.matrices[2]
    load, later = machine.load(instants), machine.load(instants + shift)
    change = load - later @ matrix.T
    length = max((np.abs(one.place(instants)).max() for one in machine.limits), default=0.0)
    stiff, pushed = np.abs(stiffness).max(initial=0), np.abs(load).max(initial=0)
    # Stops at 0 give no length: that to which the load stretches the springs does.
    length = max(length, pushed / stiff if stiff > 0 else 0.0)
    size = max(pushed, stiff * length, 1e-300)
    rows, values, sizes = [*stiffness], [*change.T], [size] * len(stiffness)
    for one, (k, sign) in zip(machine.limits, pairs, strict=True):
        away = one.place(instants) - sign * machine.limits[k].place(instants + shift)
        rows.append(0 * one.row if one.is_odd else one.row)
        values.append(away)
        sizes.append(max(length, 1e-300))
    means = np.array([value.mean() for value in values])
    offset = np.linalg.lstsq(np.array(rows), means, rcond=None)[0]
    left = np.array(values) - (np.array(rows) @ offset)[:, None]
    force = np.abs(np.array(rows)) @ np.abs(offset)
    if np.any(np.abs(left).max(axis=1) > 1e3 * _EQUAL * np.maximum(sizes, force)):
        return None
    return np.where(np.abs(offset) > 1e3 * _EQUAL * max(length, np.abs(offset).max(initial=0)), offset, 0.0)


def _keeps_force(machine: _Machine, matrix: np.ndarray, shift: float, offset: np.ndarray) -> bool:
    """True if the force has the symmetry at random states of several sizes."""
    if machine.force is None:
        return True
    rng, n = np.random.default_rng(0), len(offset)
    sizes = np.logspace(-1, 1, _STATES)[:, None]
    x, v = (sizes * rng.normal(size=(_STATES, n)) for _ in range(2))
    instants = rng.uniform(size=_STATES)
    ours = machine.force(instants, x @ matrix.T + offset, v @ matrix.T)
    theirs = machine.force(instants + shift, x, v) @ matrix.T
    return bool(np.all(np.abs(ours - theirs) <= _EQUAL_FORCE * np.abs(ours).max(axis=0, initial=0).max()))


def _is_near(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.all(np.abs(one - other) <= _EQUAL * np.maximum(1, np.abs(one))))


def _is_equal(one: Any, other: Any) -> bool:
    one, other = np.asarray(one), np.asarray(other)
    return one.shape == other.shape and bool(
        np.all(np.abs(one - other) <= _EQUAL * np.maximum(np.abs(one), np.abs(other)))
    )
