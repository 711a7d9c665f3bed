"""Compiled programs kept from one process to the next."""

import os
from pathlib import Path

import jax
from platformdirs import user_cache_path

from .._writing import naming_argument

try:
    from jax.experimental.compilation_cache.compilation_cache import reset_cache
except ImportError:  # without it, nothing may have been compiled before
    reset_cache = None


def keep_compiled(folder: str | os.PathLike[str] | None = None) -> Path:
    """Keep what is compiled in a folder, where later processes that say the same find it.

    A first `simulate` or `sweep` of a kind of machine then takes a fraction of the time. It is JAX's own persistent cache,
    for all programs of the process, also those that take little time to compile. Functions that call back into Python,
    as those under a `jax.jit` of one's own in which `simulate` may raise, are not kept.

    Args:
        folder: where; if left out, the folder of the user for such files, `~/.cache/vijax` on Linux. It may be
            deleted at any time, and holds programs for one kind of processor and one release of JAX each.

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
    if reset_cache is not None:  # earlier compilations have fixed the cache to no folder
        reset_cache()
    return place
