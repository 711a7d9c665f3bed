"""How a trajectory ended: result codes, each with a sentence that says what to do."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import equinox as eqx
import numpy as np

from .._jax.arrays import Reals, array_namespace
from .._jax.concrete import concrete


class RESULTS(eqx.Enumeration):
    """Results of a trajectory, each with a message that says what to do."""

    successful = "successful: the motion reached its end."
    max_events_reached = (
        "max_events_reached: the motion is complete, but there were more events than the log holds. "
        "Increase `max_events`, or shorten the time span."
    )
    max_impacts_reached = (
        "max_impacts_reached: the motion is complete, but there were more impacts than are recorded. "
        "Increase `max_impacts`, or record fewer periods."
    )
    max_steps_reached = (
        "max_steps_reached: the motion stopped before its end, because it took too many steps. "
        "Increase `max_steps`; if that does not help, look for a scale of time far shorter than the rest, "
        "or a force that jumps."
    )
    non_finite = (
        "non_finite: the motion stopped before its end at a number that is infinite or NaN. "
        "Check that the system, the start, and a force with its derivatives, are finite and of moderate size."
    )
    unsound_start = (
        "unsound_start: nothing was simulated, because the start lies beyond a stop, times are out of "
        "order, or a number is not finite. Start every mass between its stops, with t0 <= ts <= t1."
    )
    max_reverse_steps_reached = (
        "max_reverse_steps_reached: no longer used, as derivatives in reverse mode have no bound on the steps any more. "
        "Leave out `max_reverse_steps`."
    )
    friction_paradox = (
        "friction_paradox: the motion stopped before its end, where contacts with friction neither hold, slip nor open in agreement "
        "with the laws (Painleve). Lower the coefficients of friction, or let a contact yield: `vx.CompliantContact`."
    )


def result_sentences(result: Any, allowed: Sequence[Any] = ()) -> tuple[Reals, list[str]]:
    """Arguments of `checked` for a result code: number of the sentence to raise, or 0, and all sentences."""
    known = concrete(result._value)
    number = result._value if known is None else known
    for one in allowed:
        number = array_namespace(number).where(number == np.asarray(one._value), 0, number)
    return number, [*_sentences(result._enumeration)]


@cache
def _sentences(results: Any) -> list[str]:
    return [results[getattr(results, name)] for name in results._name_to_item]
