"""Progress bar and Ctrl-C, for all long calls.

The bar is a widget in notebooks that can show one, else a line of text. Ctrl-C raises `KeyboardInterrupt` out of
every call, so that a script does not go on with half a result unnoticed. The content of a `store` or `out` stays
there. Branches and curves come with the error, because a part of one is as good as a shorter one.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import TqdmWarning

with warnings.catch_warnings():
    # A notebook without ipywidgets gets the line of text, without a warning at every import.
    warnings.simplefilter("ignore", TqdmWarning)
    from tqdm.auto import tqdm as tqdm


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
def interrupt_with_word_of(kept: Any) -> Iterator[None]:
    """Let Ctrl-C say what is kept on disk: nothing if `kept`, a folder or store, is None."""
    try:
        yield
    except KeyboardInterrupt:
        if kept is None:
            sentence = "Stopped; nothing is kept. With `store` a sweep keeps its finished points, and the same call resumes there."
        else:
            sentence = (
                f"Stopped; the points finished until then are in {kept}, and the same call resumes there."
            )
        raise KeyboardInterrupt(sentence) from None
