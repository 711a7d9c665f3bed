"""Names of bifurcations and of ends of branches, each defined once, with its label in pictures."""

from enum import StrEnum
from typing import TYPE_CHECKING, Literal

# Public kinds, for editors, which complete them; at run time a wrong one is refused in a sentence.
if TYPE_CHECKING:
    PublicKind = Literal[
        "fold",
        "pd",
        "ns",
        "bp",
        "pitchfork",
        "gr",
        "double_impact",
        "force_zero",
        "chatter_completion",
        "crossing_sliding",
        "grazing_sliding",
        "switching_sliding",
        "adding_sliding",
    ]
else:
    PublicKind = str


class Kind(StrEnum):
    """Kind of a bifurcation; a member is the string that users read in `point.kind`.

    Attributes:
        words: label in legends.
        is_critical: True if a multiplier lies on the unit circle, so that stability is decided by rounding.
    """

    words: str
    is_critical: bool

    FOLD = "fold", "fold", True
    PERIOD_DOUBLING = "pd", "period doubling", True
    NEIMARK_SACKER = "ns", "Neimark-Sacker", True
    BRANCH_POINT = "bp", "branch point", True
    # A branch point at which a symmetry of the orbits is broken.
    PITCHFORK = "pitchfork", "pitchfork", True
    GRAZING = "gr", "grazing", False
    DOUBLE_IMPACT = "double_impact", "double impact", False
    FORCE_ZERO = "force_zero", "force zero", False
    # Of friction, see M. di Bernardo et al., Piecewise-smooth Dynamical Systems (2008), Ch. 8.
    CROSSING_SLIDING = "crossing_sliding", "crossing-sliding", False
    GRAZING_SLIDING = "grazing_sliding", "grazing-sliding", False
    SWITCHING_SLIDING = "switching_sliding", "switching-sliding", False
    ADDING_SLIDING = "adding_sliding", "adding-sliding", False
    CHATTER_COMPLETION = "chatter_completion", "chatter completion", False
    # Crossing-sliding within an impact: friction of the contact begins to stick there, or to slip.
    IN_IMPACT = "in_impact", "crossing-sliding", False
    # Grazing, seen from one side only: a gap touches zero.
    TOUCH = "touch", "grazing", False
    # Chatter completion, seen from one side only: a stick begins.
    ONSET = "onset", "chatter completion", False
    # Double impact, seen from one side only: friction torn off by the event of another element would stick on.
    TEAR = "tear", "double impact", False
    # Branch point, seen from one side only: an orbit traversed twice.
    HALF_PERIOD = "period_doubling", "branch point", True

    def __new__(cls, name: str, words: str, is_critical: bool) -> "Kind":
        member = str.__new__(cls, name)
        member._value_, member.words, member.is_critical = name, words, is_critical
        return member


_SHOWN: dict[str, str] = {
    Kind.TOUCH: Kind.GRAZING,
    Kind.ONSET: Kind.CHATTER_COMPLETION,
    Kind.IN_IMPACT: Kind.CROSSING_SLIDING,
    Kind.TEAR: Kind.DOUBLE_IMPACT,
    # At the end of a doubled branch, the branch of half the period, traversed twice, crosses it.
    Kind.HALF_PERIOD: Kind.BRANCH_POINT,
}


def public_kind(kind: str) -> str:
    """Public kind: one name for both sides from which a bifurcation is seen."""
    return str(_SHOWN.get(kind, kind))


# Prefixes of what users name: the kind of a zero of a monitor, and the end of a branch where a condition holds.
MONITOR, STOP = "monitor:", "stop:"


class EndKind(StrEnum):
    """Reasons for which a branch ends, besides the kinds of bifurcations."""

    BOUNDS = "bounds"
    CLOSED = "closed"
    MAX_POINTS = "max_points"
    MAX_EVENTS = "max_events"
    INTERRUPTED = "interrupted"
    NOT_CONVERGED = "not_converged"
    SEVERAL_EVENTS = "several_events"
    LEFT_THE_STOPS = "left_the_stops"
    # Of a curve of peaks: another extreme of the cycle is as high.
    OTHER_EXTREME = "other_extreme"
