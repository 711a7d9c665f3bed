"""What long calls have in common: a progress bar, and what Ctrl-C does.

The bar is a widget in notebooks that can show one, else a line of text. Ctrl-C raises `KeyboardInterrupt` out of every
call, so that a script does not go on with half of a result unseen. What a `store` or `out` holds stays there; branches and
curves, of which a part is as good as a shorter one, come along with the error.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import TqdmWarning

with warnings.catch_warnings():
    # A notebook without ipywidgets gets the line of text; nobody has to be warned at every import.
    warnings.simplefilter("ignore", TqdmWarning)
    from tqdm.auto import tqdm as tqdm


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a call that follows branches or a curve; what was followed until then comes along.

    Attributes:
        result: what the call would have returned, as far as it came; those that are not complete have an end "interrupted".

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
def bringing(result: Callable[[], Any]) -> Iterator[None]:
    """Let Ctrl-C bring along what there is when it comes."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(result()) from None
