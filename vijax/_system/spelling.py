"""Suggestions for unknown names, which may be misspelt."""

import re
from collections.abc import Iterable
from difflib import SequenceMatcher

# Least similarity of a suggestion: "dampng" and "damping" have 0.92, "omega" and "mean" 0.44.
_ALIKE = 0.7


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Question to append to a message; empty if no valid name is similar.

    The end of a path counts as much as the whole, for users who omit the parent: "amplitude" is similar to
    "forcing.amplitude".

    Args:
        name: the unknown name, perhaps followed by an index.
        known: the valid names, the likelier first.
    """
    plain, index = _apart(_with_brackets(name))
    likeness = {other: _likeness(plain, other) for other in known}
    best = max(likeness, key=likeness.__getitem__, default=name)
    # A name that is right except for an index is not misspelt.
    is_spelt = _without_index(best) == _without_index(plain) and name == plain + index
    if likeness.get(best, (0.0,))[0] < _ALIKE or is_spelt:
        return ""
    return f" Instead of `{name}`, did you mean `{best}{index}`?"


def _likeness(name: str, other: str) -> tuple[float, float]:
    """Similarity of the wholes or of the ends, the larger one; and of the wholes."""
    pairs = (name, other), (_end(name), _end(other))
    whole, end = (SequenceMatcher(None, a.lower(), b.lower()).ratio() for a, b in pairs)
    return max(whole, end), whole


def _end(path: str) -> str:
    return path.rpartition(".")[2]


def _apart(path: str) -> tuple[str, str]:
    """A path and the indices that follow it."""
    match = re.fullmatch(r"(.*?)((?:\[\d+\])*)", path, re.DOTALL)
    assert match is not None
    return match[1], match[2]


def _with_brackets(path: str) -> str:
    """A path whose indices stand as NumPy has them, `stiffness[0, 1]`, as paths have them, `stiffness[0][1]`."""
    return re.sub(
        r"\[\d+(?:\s*,\s*\d+)+\]", lambda all: "".join(f"[{one}]" for one in re.findall(r"\d+", all[0])), path
    )


def _without_index(path: str) -> str:
    return re.sub(r"\[(\d+|\*)\]", "[]", path)
