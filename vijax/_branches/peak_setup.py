"""From a cycle at a peak to the condition that keeps it there."""

import numpy as np

from .._orbits.sequence import Sequence
from .extremes import Extremes, extremes_of_cycle
from .parameter_family import ExtendedCycle, ParameterFamily
from .peak_condition import AtPeak
from .peak_quantities import PeakQuantity, peak_quantity
from .requests import KernelCall
from .scheduler import answer


def peak_condition(family: ParameterFamily, sequence: Sequence, place: ExtendedCycle, words: str) -> AtPeak:
    """Condition that a quantity, given by its name with a mass, is stationary at a cycle."""
    wanted = peak_quantity(words, family.system)
    extremes = extremes_at(family, sequence, place)
    flights, times, sides = wanted.places(extremes)
    weights = np.zeros(len(place.z) + len(place.flights) + 1)
    return AtPeak(times, wanted.signs, np.asarray(wanted.coordinate), flights, sides, weights)


def extremes_at(family: ParameterFamily, sequence: Sequence, place: ExtendedCycle) -> Extremes:
    """Extremes of a cycle of a family with one parameter or two."""
    nowhere = ExtendedCycle(*(0 * np.asarray(a) for a in place))
    return answer(family, KernelCall(extremes_of_cycle, sequence, (place, nowhere)))


def is_at_its_extremes(condition: AtPeak, extremes: Extremes, wanted: PeakQuantity) -> bool:
    """True if the extremes of a condition are those of the cycle."""
    flights, _, sides = wanted.places(extremes)
    return bool(np.array_equal(condition.flights, flights) and np.array_equal(condition.sides, sides))
