"""Progress bar, word of what compiles, and Ctrl-C, for all long calls.

The bar is a widget in notebooks that can show one, else a line of text. Ctrl-C raises `KeyboardInterrupt` out of
every call, so that a script does not go on with half a result unnoticed. The content of a `store` or `out` stays
there. Branches and curves come with the error, because a part of one is as good as a shorter one.
"""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from inspect import unwrap
from typing import Any, ParamSpec, TypeVar

from tqdm import TqdmWarning

from ._jax.announcing import Stage, announced_to, is_announced
from ._printing import words_of_kind

with warnings.catch_warnings():
    # A notebook without ipywidgets gets the line of text, without a warning at every import.
    warnings.simplefilter("ignore", TqdmWarning)
    from tqdm.auto import tqdm as tqdm

P = ParamSpec("P")
R = TypeVar("R")

_SENTENCES = {
    Stage.COMPILES: "compiling for {kind}, once for this kind, kept for later",
    Stage.COMPILES_NOW: "compiling for {kind}, once for this kind in this process",
    Stage.TRACES: "tracing for {kind}, once in every process, and compiling what is not kept from before",
    Stage.WAITS: "waiting for another process that compiles for {kind}",
}
# Sentences that this process has printed.
_said: set[str] = set()


def says_what_compiles(function: Callable[P, R]) -> Callable[P, R]:
    """Let a public function print on stderr for what it compiles as soon as it begins, each sentence once in a process.

    With `progress=False` it is silent. A function without this argument prints only where somebody looks on.
    """
    has_bar = "progress" in (unwrap(function).__kwdefaults__ or {})

    @wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        if is_announced():  # a part of another call
            return function(*args, **kwargs)

        def tell(work: Stage) -> None:
            if kwargs.get("progress", has_bar or _is_interactive()):
                _say(function.__name__, work, [*args, *kwargs.values()])

        with announced_to(tell):
            return function(*args, **kwargs)

    return wrapped


def _is_interactive() -> bool:
    """True if stderr is a terminal, or a notebook runs."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def _say(name: str, work: Stage, given: list[Any]) -> None:
    sentence = f"{name}: {_SENTENCES[work].format(kind=_kind_of(given))}"
    if sentence not in _said:
        _said.add(sentence)
        tqdm.write(sentence, file=sys.stderr)  # above the bars


def _kind_of(given: list[Any]) -> str:
    """Words for the machine among the arguments of a call: it, or what has one, such as an orbit or a bifurcation."""
    for thing in given:
        for path in ((), ("system",), ("branch", "system"), (0, "system")):
            try:
                found = thing
                for step in path:
                    found = found[step] if isinstance(step, int) else getattr(found, step)
                return words_of_kind(found)
            except Exception:  # whatever an argument raises, it is no machine
                continue
    return "this kind of machine"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a call that follows branches or a curve; the part computed until then comes with the error.

    Attributes:
        result: the result of the call as far as it came; incomplete branches and curves have an end "interrupted".

    Example:
        ```python
        import jax, numpy as np, vijax as vx
        jax.config.update("jax_enable_x64", True)
        ds = vx.sweep(vx.models.wagg_bishop_a(1.0), {"forcing.frequency": np.linspace(0.7, 1.0, 40)}, transient=200)
        try:
            found = vx.branches(ds)
        except vx.Interrupted as stopped:
            found = stopped.result
        ```
    """

    def __init__(self, result: Any):
        super().__init__(
            "Stopped; what was followed until then is the `result` of this error, `sys.last_value.result` in a notebook."
        )
        self.result = result


Interrupted.__module__ = "vijax"  # the name that users see


@contextmanager
def interrupt_with_result(result: Callable[[], Any]) -> Iterator[None]:
    """Turn Ctrl-C into `Interrupted`, with the result at that moment."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(result()) from None


@contextmanager
def interrupt_with_word_of(kept: Any, option: str = "`store`", again: str = "call") -> Iterator[None]:
    """Let Ctrl-C say what is kept on disk: nothing if `kept`, a folder or store, is None.

    Args:
        kept: where finished points are kept.
        option: word for what keeps them.
        again: word for what resumes there if it is made again.
    """
    try:
        yield
    except KeyboardInterrupt:
        if kept is None:
            sentence = f"nothing is kept. With {option} a sweep keeps its finished points, and the same {again} resumes there."
        else:
            sentence = f"the points finished until then are in {kept}, and the same {again} resumes there."
        raise KeyboardInterrupt(f"Stopped; {sentence}") from None
