"""Normal forms of bifurcations: what the machine does beside a point, to leading order.

The return map z -> P(z) of a cycle, with its events in their order, is smooth: the durations of the flights are functions of
the start, by the implicit function theorem on the guards of the events. So derivatives of P of any order follow from those of
the equations of a cycle by start and durations, which are derivatives of a program without iterations, and from one inverse
matrix, that of the guards by the durations, which is regular where no impact grazes. With the eigenvectors
q and q* of the critical
multiplier, <q*, q> = 1, and B, C the second and the third derivatives of P, the map on the centre manifold is, for a
distance delta of the parameter from its value,

    fold           xi -> xi + b delta + a xi^2
    others         |xi| -> |xi| (1 + b delta + a |xi|^2)

where z is that of the point plus xi q (plus the complex conjugate at a Neimark-Sacker point), and

    fold           a = <q*, B(q, q)> / 2
    pitchfork      a = <q*, C(q, q, q) + 3 B(q, h)> / 6,   (I - A) h = B(q, q), <q*, h> = 0
    pd             a = -<q*, C(q, q, q) + 3 B(q, h)> / 6,  (I - A) h = B(q, q)
    ns             a = Re e^{-i theta} <q*, C(q, q, q') + 2 B(q, h) + B(q', k)> / 2,
                   (I - A) h = B(q, q'), (e^{2 i theta} I - A) k = B(q, q)

Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sec. 5.4 and 10.2. Rejected: differences of exact
Jacobians, whose third derivatives have half the digits.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._jax.arrays import refuse_single_precision
from .._orbits.sequence import Sequence
from .bifurcation_setup import family_at
from .branch import Bifurcation
from .cycle_derivatives import curvature, derivative_at, slope, square_jacobian, third_derivative
from .grazing_form import GrazingForm, grazing_form_of
from .kinds import Kind
from .padding import trimmed
from .parameter_family import ExtendedCycle, ParameterFamily
from .pitchfork import crossing_direction
from .point import correct_with_free_parameter
from .requests import Requests
from .scheduler import drive

_MULTIPLIERS: dict[str, complex] = {Kind.FOLD: 1, Kind.PITCHFORK: 1, Kind.PERIOD_DOUBLING: -1}


@dataclass(frozen=True, eq=False)
class NormalForm:
    """Normal form of a bifurcation, the map of its centre manifold over the period of the orbit.

    At a fold xi -> xi + rate d + coefficient xi^2, at the others |xi| -> |xi| (1 + rate d + coefficient |xi|^2), for a
    distance d of the parameter from its value. The state at the start of the orbit is that of the point plus xi times the
    direction; at a Neimark-Sacker point xi is complex, and the complex conjugate is added.

    Attributes:
        kind: kind of the bifurcation, "fold", "pd", "ns" or "pitchfork".
        coefficient: that of the square or of the cube, per length or per length squared.
        rate: change of the offset, or of the modulus of the multiplier, by the parameter, along the orbits that go through.
        direction: eigenvector of positions and velocities, (2 n,), of length 1 if velocities are divided by the frequency.
    """

    kind: str
    coefficient: float
    rate: float
    direction: np.ndarray

    @property
    def criticality(self) -> str:
        """Whether the orbits that branch off are stable, as far as the other multipliers tell.

        Is "supercritical" where they are, "subcritical" where they are not, and empty at a fold, where two orbits meet that are one stable, one unstable along `direction`.
        """
        if self.kind == Kind.FOLD:
            return ""
        return "supercritical" if self.coefficient < 0 else "subcritical"

    @property
    def side(self) -> str:
        """Side on which they are, "above" if the orbits that branch off, or both that meet at a fold, exist at larger values, else "below"."""
        return "above" if self.rate * self.coefficient < 0 else "below"

    def amplitude(self, distance: float) -> float:
        """|xi| of the orbits that branch off, or of those of a fold, at a distance of the parameter; NaN on the other side."""
        square = -self.rate * distance / self.coefficient
        return float(np.sqrt(square)) if square >= 0 else np.nan

    def __repr__(self) -> str:
        words = f"{self.criticality} {self.kind}".strip()
        return f"<NormalForm {words}, orbits {self.side}, coefficient {self.coefficient:.9g}, rate {self.rate:.9g}>"


def normal_form_of(point: Bifurcation) -> NormalForm | GrazingForm:
    """Normal form of a bifurcation, see `Bifurcation.normal_form`."""
    refuse_single_precision("normal_form", point.branch.points["x0"])
    if point.kind == Kind.GRAZING:
        return grazing_form_of(point)
    if point.kind not in (*_MULTIPLIERS, Kind.NEIMARK_SACKER):
        raise ValueError(
            'A normal form belongs to points of kind "fold", "pd", "ns" and "pitchfork", where a multiplier is on the unit circle, '
            f'and to a "gr", but this is a {point.kind!r}.'
        )
    values = point.branch.values
    low, high = float(values.min()), float(values.max())
    _, family, sequence, place = family_at(point, *((low, high) if low < high else (low - 1, high + 1)))
    (found,) = drive([family], [_normal_form(family, point.kind, sequence, place)], lambda: None)
    return found


def cubic_coefficient(
    family: ParameterFamily, kind: str, sequence: Sequence, place: ExtendedCycle
) -> Requests[float]:
    """`NormalForm.coefficient` of a cycle of kind "pd" or "ns", for a family of any number of parameters."""
    returned = yield from _return_map(sequence, place)
    multiplier, q, left = _eigenvectors(returned.matrix, kind, float(family.scale[0]))
    return (yield from _cubic(returned, kind, multiplier, q, left))


class _ReturnMap(NamedTuple):
    """The return map z -> P(z), with the derivatives of the equations of the cycle and of its events.

    Attributes:
        sequence: of the events.
        place: the cycle.
        end: derivative of the state after the period by the start and the durations, (2 n, unknowns).
        lift: derivative of start and durations by the start, the events on their guards, (unknowns, 2 n).
        solve: minus the durations that a change of the guards needs, as a matrix, (events, events).
    """

    sequence: Sequence
    place: ExtendedCycle
    end: np.ndarray
    lift: np.ndarray
    solve: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """Jacobian of the map, (2 n, 2 n)."""
        return self.end @ self.lift

    def lifted(self, u: np.ndarray) -> np.ndarray:
        """Start and durations of a neighbour."""
        return self.lift @ u

    def first(self, direction: np.ndarray) -> Requests[np.ndarray]:
        """Derivative of P by what moves start, durations and parameter, with the durations that follow."""
        return self._split((yield from self._ask(slope, direction)))[0]

    def second(self, u: np.ndarray, v: np.ndarray) -> Requests[tuple[np.ndarray, np.ndarray]]:
        """Second derivative along directions of start, durations and parameter, and that of the durations."""
        return self._split((yield from self._ask(curvature, u, v)))

    def third(self, u: np.ndarray, v: np.ndarray, w: np.ndarray) -> Requests[np.ndarray]:
        """Third derivative along three lifted directions."""
        total = yield from self._ask(third_derivative, u, v, w)
        for one, (first, other) in ((u, (v, w)), (v, (u, w)), (w, (u, v))):
            later = (yield from self.second(first, other))[1]
            change = np.append(np.zeros(len(self.place.z)), later)
            total = total + (yield from self._ask(curvature, one, change))
        return self._split(total)[0]

    def _split(self, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change of the state after the period with the events on their guards, and that of the durations."""
        size = len(self.place.z)
        later = self.solve @ change[size:]
        return change[:size] + self.end[:, size:] @ later, later

    def _ask(self, kernel: Callable, *directions: np.ndarray) -> Requests[np.ndarray]:
        size, num = len(self.place.z), len(self.place.z) + len(self.place.flights)
        shape = np.shape(self.place.p)
        given = [
            ExtendedCycle(d[:size], d[size:num], np.full(shape, np.append(d, 0.0)[num])) for d in directions
        ]
        return (yield from derivative_at(kernel, self.sequence, self.place, *given))


def _return_map(sequence: Sequence, place: ExtendedCycle) -> Requests[_ReturnMap]:
    size, num = len(place.z), len(place.z) + len(place.flights)
    matrix = yield from square_jacobian(sequence, place)
    solve = -np.linalg.inv(matrix[size:, size:])
    lift = np.vstack([np.eye(size), solve @ matrix[size:, :size]])
    return _ReturnMap(sequence, place, matrix[:size] + np.eye(size, num), lift, solve)


def _normal_form(
    family: ParameterFamily, kind: str, sequence: Sequence, place: ExtendedCycle
) -> Requests[NormalForm]:
    """The normal form at a cycle."""
    returned = yield from _return_map(sequence, place)
    multiplier, q, left = _eigenvectors(returned.matrix, kind, float(family.scale[0]))
    if kind == Kind.FOLD:
        along_p = np.append(np.zeros(len(place.z) + len(place.flights)), 1.0)
        coefficient = left @ (yield from _bilinear(returned, q, q)) / 2
        rate = left @ (yield from returned.first(along_p))
    else:
        tangent = yield from _tangent(kind, sequence, place)
        rate = np.conj(multiplier) * (left @ (yield from _second(returned, returned.lifted(q), tangent)))
        coefficient = yield from _cubic(returned, kind, multiplier, q, left)
    direction = q * np.asarray(family.scale)
    return NormalForm(
        kind=str(kind),
        coefficient=float(np.real(coefficient)),
        rate=float(np.real(rate) / float(family.span)),
        direction=direction if kind == Kind.NEIMARK_SACKER else np.real(direction),
    )


def _eigenvectors(matrix: np.ndarray, kind: str, length: float) -> tuple[complex, np.ndarray, np.ndarray]:
    """The critical multiplier, on the unit circle, and its eigenvectors from the right and the left, with product 1."""
    values, right = np.linalg.eig(matrix)
    if kind == Kind.NEIMARK_SACKER:
        k = int(np.argmin(np.where(np.imag(values) > 0, np.abs(np.abs(values) - 1), np.inf)))
        multiplier = values[k] / abs(values[k])
    else:
        multiplier = complex(_MULTIPLIERS[kind])
        k = int(np.argmin(np.abs(values - multiplier)))
    q = right[:, k] / np.linalg.norm(right[:, k])
    q = q * np.conj(q[np.argmax(np.abs(q))]) / np.abs(q).max() / length
    others, all_left = np.linalg.eig(matrix.T)
    left = all_left[:, int(np.argmin(np.abs(others - values[k])))]
    if kind != Kind.NEIMARK_SACKER:
        q, left = q.real.astype(complex), (left / left[np.argmax(np.abs(left))]).real
    return multiplier, q, left / (left @ q)


def _tangent(kind: str, sequence: Sequence, place: ExtendedCycle) -> Requests[np.ndarray]:
    """Change of start, durations and parameter along the orbits that go through, by the parameter."""
    if kind == Kind.PITCHFORK:
        along = yield from crossing_direction(sequence, place)
    else:
        found = (yield from correct_with_free_parameter(sequence, place)).found
        along = trimmed(found.tangent, len(place.flights))
    return np.concatenate([along.z, along.flights, [along.p]]) / along.p


def _cubic(
    returned: _ReturnMap, kind: str, multiplier: complex, q: np.ndarray, left: np.ndarray
) -> Requests[float]:
    """Coefficient of the cube in the normal form."""
    matrix, one = returned.matrix, np.eye(len(q))
    if kind == Kind.NEIMARK_SACKER:
        h = np.linalg.solve(one - matrix, (yield from _bilinear(returned, q, np.conj(q))))
        k = np.linalg.solve(multiplier**2 * one - matrix, (yield from _bilinear(returned, q, q)))
        by_h, by_k = (yield from _bilinear(returned, q, h)), (yield from _bilinear(returned, np.conj(q), k))
        cube = left @ ((yield from _trilinear(returned, q)) + 2 * by_h + by_k) / 2
        return float(np.real(np.conj(multiplier) * cube))
    square = yield from _bilinear(returned, q, q)
    if kind == Kind.PITCHFORK:
        bordered = np.block([[one - matrix, q[:, None]], [left[None], np.zeros((1, 1))]])
        h = np.linalg.solve(bordered, np.append(square, 0.0))[:-1]
    else:
        h = np.linalg.solve(one - matrix, square)
    u = returned.lifted(np.real(q))
    cube = yield from returned.third(u, u, u)
    cube = left @ (cube + 3 * (yield from _bilinear(returned, q, h))) / 6
    return float(np.real(np.conj(multiplier) * cube))


def _bilinear(returned: _ReturnMap, u: np.ndarray, v: np.ndarray) -> Requests[np.ndarray]:
    """Second derivative along two complex directions of the start."""
    return (yield from _second(returned, returned.lifted(u), returned.lifted(v)))


def _second(returned: _ReturnMap, u: np.ndarray, v: np.ndarray) -> Requests[np.ndarray]:
    """Second derivative along two complex directions of start, durations and parameter."""
    found = np.zeros(len(returned.matrix), complex)
    for a, unit in ((np.real(u), 1), (np.imag(u), 1j)):
        for b, other in ((np.real(v), 1), (np.imag(v), 1j)):
            if np.any(a) and np.any(b):
                found = found + unit * other * (yield from returned.second(a, b))[0]
    return found


def _trilinear(returned: _ReturnMap, q: np.ndarray) -> Requests[np.ndarray]:
    """Third derivative C along q, q and its conjugate, q = a + i b: C(a, a, a) + C(a, b, b) + i (C(a, a, b) + C(b, b, b))."""
    a, b = returned.lifted(np.real(q)), returned.lifted(np.imag(q))
    real = (yield from returned.third(a, a, a)) + (yield from returned.third(a, b, b))
    return real + 1j * ((yield from returned.third(a, a, b)) + (yield from returned.third(b, b, b)))
