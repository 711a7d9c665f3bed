"""Compiled programs kept from one process to the next."""

import os
from pathlib import Path

import jax
from platformdirs import user_cache_path

from .._writing import naming_argument

try:
    from jax.experimental.compilation_cache.compilation_cache import reset_cache
except ImportError:  # without it, the cache works only if nothing was compiled before
    reset_cache = None


def keep_compiled(folder: str | os.PathLike[str] | None = None) -> Path:
    """Keep compiled programs in a folder, where later processes that make the same call find them.

    The first `simulate` or `sweep` of a kind of machine then takes a fraction of the time. This is JAX's own
    persistent cache, for all programs of the process, including those that compile quickly. Functions that call back
    into Python are not kept, for example those under your own `jax.jit` in which `simulate` may raise.

    Args:
        folder: the folder; if left out, the user's folder for caches, `~/.cache/vijax` on Linux. It may be deleted at
            any time. Each program in it serves one kind of processor and one release of JAX.

    Returns:
        The folder.

    Raises:
        ValueError: if the folder cannot be made.

    Example:
        ```python
        import vijax as vx
        vx.keep_compiled()
        sol = vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 50.0)
        ```
    """
    place = user_cache_path("vijax") if folder is None else Path(folder)
    with naming_argument("folder", place):
        place.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_compilation_cache_dir", str(place))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    if reset_cache is not None:  # earlier compilations initialised the cache without a folder
        reset_cache()
    return place
