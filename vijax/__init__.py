"""Vibro-impact machines in JAX: exact between impacts, no impact missed, differentiable, in batches.

The public names stand in `__init__.pyi`, for type checkers and for this file. Each is imported on first use, so that
a simulation of one machine does not wait for xarray, matplotlib or diffrax.
"""

import lazy_loader as _lazy_loader

from ._dataset_attributes import version as _version
from ._signatures import with_short_signature as _with_short_signature

_public, __dir__, __all__ = _lazy_loader.attach_stub(__name__, __file__)
__version__ = _version("vijax")


def __getattr__(name: str):
    from ._calls import with_explained_errors  # JAX comes with it

    globals()[name] = found = with_explained_errors(_with_short_signature(_public(name)), __name__)
    return found
