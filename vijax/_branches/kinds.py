"""Names of bifurcations and of the ends of branches: each stands once, with the words that pictures show."""

from enum import StrEnum


class Kind(StrEnum):
    """Kind of a bifurcation; a member is the string that users read in `point.kind`.

    Attributes:
        words: for legends.
        is_critical: whether a multiplier is on the unit circle, so that stability is rounding.
    """

    words: str
    is_critical: bool

    FOLD = "fold", "fold", True
    PERIOD_DOUBLING = "pd", "period doubling", True
    NEIMARK_SACKER = "ns", "Neimark-Sacker", True
    BRANCH_POINT = "bp", "branch point", True
    GRAZING = "gr", "grazing", False
    DOUBLE_IMPACT = "double_impact", "double impact", False
    FORCE_ZERO = "force_zero", "force zero", False
    CHATTER_COMPLETION = "chatter_completion", "chatter completion", False
    # Seen from one side alone: a gap that touches zero, a stick that begins, an orbit traversed twice.
    TOUCH = "touch", "grazing", False
    ONSET = "onset", "chatter completion", False
    HALF_PERIOD = "period_doubling", "branch point", True

    def __new__(cls, name: str, words: str, is_critical: bool) -> "Kind":
        member = str.__new__(cls, name)
        member._value_, member.words, member.is_critical = name, words, is_critical
        return member


_SHOWN: dict[str, str] = {
    Kind.TOUCH: Kind.GRAZING,
    Kind.ONSET: Kind.CHATTER_COMPLETION,
    # Where a doubled branch ends, the branch of half the period, traversed twice, crosses it.
    Kind.HALF_PERIOD: Kind.BRANCH_POINT,
}


def shown(kind: str) -> str:
    """The kind that users read: one name for what is seen from two sides."""
    return str(_SHOWN.get(kind, kind))


class End(StrEnum):
    """Reason why a branch ends, beside the kinds of bifurcations at which it may."""

    BOUNDS = "bounds"
    CLOSED = "closed"
    MAX_POINTS = "max_points"
    INTERRUPTED = "interrupted"
    NOT_CONVERGED = "not_converged"
    SEVERAL_EVENTS = "several_events"
    LEFT_THE_STOPS = "left_the_stops"
