"""Normal form of a grazing: the square root by which a stop that is just reached changes the return map.

Let the least gap g of a neighbour of the grazing orbit vanish, or be negative if the stop were not there. At a depth d = -g
the neighbour hits the stop with the speed sqrt(2 a d), for the acceleration a of the gap at the touch, and so

    P(z) = P_free(z) + w sqrt(d),    g = c . (z - z*) + rate (p - p*)

to leading order. On the cycle with an impact of zero speed inserted, whose instant is moved by sigma, the gap there is
g + a sigma^2 / 2, zero at sigma = -sqrt(2 d / a), and the end moves by its derivative by sigma: w is minus that times
sqrt(2 / a). A. B. Nordmark, J. Sound Vib. 145 (1991), 279-297; M. di Bernardo, C. J. Budd, A. R. Champneys &
P. Kowalczyk, Piecewise-smooth Dynamical Systems (2008), Sec. 6.2.
"""

from dataclasses import dataclass

import numpy as np

from .._orbits.sequence import Sequence
from .branch import Bifurcation
from .cycle_derivatives import curvature, derivative_at, slope, square_jacobian
from .kinds import Kind
from .parameter_family import ExtendedCycle, ParameterFamily
from .requests import Requests
from .scheduler import drive
from .tolerances import NEGLIGIBLE
from .touch import touching_impact


@dataclass(frozen=True, eq=False)
class GrazingForm:
    """Normal form of a grazing: what the stop adds to the return map, to leading order.

    A neighbour z of the orbit, at its start, has the least gap g = gradient . (z - z*) + rate (p - p*) where the orbit
    grazes. Where that is negative it hits the stop, and the state after the period is that without the stop plus
    `square_root` times sqrt(-g).

    Attributes:
        kind: "gr".
        square_root: of positions and velocities, (2 n,), per square root of a length.
        gradient: derivative of the least gap by positions and velocities at the start, (2 n,).
        rate: derivative of the least gap by the parameter, at the same start.
    """

    kind: str
    square_root: np.ndarray
    gradient: np.ndarray
    rate: float

    @property
    def criticality(self) -> str:
        """Always empty, as what branches off a grazing is not a matter of one coefficient."""
        return ""

    def __repr__(self) -> str:
        words = ", ".join(f"{a:.9g}" for a in self.square_root)
        return f"<GrazingForm square root ({words}), rate {self.rate:.9g}>"


def grazing_form_of(point: Bifurcation) -> GrazingForm:
    """Normal form of a grazing, see `Bifurcation.normal_form`."""
    _, family, sequence, place, k = touching_impact(point)
    (found,) = drive([family], [_grazing_form(family, sequence, place, k)], lambda: None)
    return found


def _grazing_form(
    family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, k: int
) -> Requests[GrazingForm]:
    """The normal form of a cycle whose event `k` is the impact that grazes."""
    size, num = len(place.z), len(place.z) + len(place.flights)
    matrix = yield from square_jacobian(sequence, place)
    along_p = ExtendedCycle(0 * place.z, 0 * place.flights, np.ones(()))
    by_p = yield from derivative_at(slope, sequence, place, along_p)
    moved = ExtendedCycle(0 * place.z, np.eye(num - size)[k], np.zeros(()))
    bent = yield from derivative_at(curvature, sequence, place, moved, moved)
    others = np.delete(np.arange(size, num), k)
    guards = matrix[np.ix_(others, others)]
    speeds = np.abs(np.diag(guards))
    if np.any(speeds < NEGLIGIBLE * speeds.max(initial=0)):
        raise ValueError("Several impacts graze at this point at once: the square root is that of one alone.")
    # By start, instant of the touch and parameter; the other events stay on their guards.
    free = np.column_stack([matrix[:, :size], matrix[:, size + k], by_p])
    total = free - matrix[:, others] @ np.linalg.solve(guards, free[others])
    acceleration, gap = bent[size + k], total[size + k]
    scale, span = np.asarray(family.scale), float(family.span)
    return GrazingForm(
        kind=str(Kind.GRAZING),
        square_root=-total[:size, size] * np.sqrt(2 / acceleration) * scale,
        gradient=gap[:size] / scale,
        rate=float(gap[-1] / span),
    )
