"""Degenerate period doublings and Neimark-Sacker points: places of their curves where the cubic of the normal form vanishes.

There the orbits that branch off turn from stable to unstable.

Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sec. 9.3 (generalised flip) and 9.4 (Chenciner).
"""

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from .._orbits.sequence import Sequence
from .codim2_tests import CurveNeighbourhood, CurveTest
from .kinds import Kind
from .normal_form import cubic_coefficient
from .padding import trimmed
from .parameter_family import ParameterFamily
from .scheduler import drive
from .tolerances import HALF_DIGITS

# Kinds whose normal forms have a cubic.
_CUBIC = Kind.PERIOD_DOUBLING, Kind.NEIMARK_SACKER


@dataclass
class DegenerateMultiplier:
    """Test for points of a curve where the cubic of the normal form vanishes.

    Attributes:
        kind: of the curve.
        known: the last points of the curve, with the values there.
    """

    kind: str
    known: list[tuple[CurveNeighbourhood, float]] = field(default_factory=list)

    def tests(self, family: ParameterFamily, sequence: Sequence, here: CurveNeighbourhood) -> list[CurveTest]:
        """Tests of a step from a point: none for a kind without a cubic."""
        if self.kind not in _CUBIC:
            return []
        name, value = f"degenerate_{self.kind}", partial(self.value, family, sequence)
        # Beside a resonant grazing the cubic changes its sign at infinity.
        name_at = lambda near: name if abs(value(near)) <= HALF_DIGITS * abs(value(here)) else ""  # noqa: E731
        return [CurveTest(name, lambda near, _: value(near), name_at=name_at)]

    def value(self, family: ParameterFamily, sequence: Sequence, near: CurveNeighbourhood) -> float:
        """Function that changes sign with the cubic, and is finite where that is not."""
        for point, value in self.known:
            if point is near:
                return value
        place = trimmed(near.at.place, len(sequence.kind))
        try:
            with np.errstate(all="ignore"):
                task = cubic_coefficient(family, self.kind, sequence, place)
                (cubic,) = drive([family], [task], lambda: None)
        except np.linalg.LinAlgError:
            return np.nan
        # The cubic is infinite where another multiplier is 1, and at the resonance 1:3.
        value = cubic * float(near.faces[0].fold)
        if self.kind == Kind.NEIMARK_SACKER:
            value *= float(np.sin(1.5 * near.at.own[0]))
        self.known = [(near, value), *self.known[:1]]
        return value
