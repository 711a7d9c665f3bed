"""Folders that keep compiled programs from one process to the next."""

import os
from pathlib import Path

import jax
from platformdirs import user_cache_path

from .._writing import naming_argument
from .program_store import store_programs

try:
    from jax.experimental.compilation_cache.compilation_cache import reset_cache
except ImportError:  # without it, the cache works only if nothing was compiled before
    reset_cache = None


def keep_compiled(folder: str | os.PathLike[str] | None = None) -> Path:
    """Keep all compiled programs in a folder, where later processes that make the same call find them.

    The library keeps its own programs in any case, in `~/.cache/vijax/programs` on Linux, so that a second process
    starts a branch in seconds. This function chooses another folder for them, and also keeps the programs of your own
    functions under `jax.jit`, by JAX's persistent cache. The environment variable `VIJAX_PROGRAMS` names another folder
    for the programs of the library, or turns that off: `VIJAX_PROGRAMS=off`.

    At most 1 GiB of the library's programs is kept; those not used for longest are removed. A program serves one kind
    of processor, one release of each library and one state of the source. Programs of derivatives, and those that depend
    on a function or a class of yours, a `force=` for instance, are traced in every process, but not compiled. One that
    calls back into Python is never stored.

    Args:
        folder: the folder; if left out, the user's folder for caches, `~/.cache/vijax` on Linux. It may be deleted at
            any time. Programs are machine code, which runs when it is found: name no folder that others can write.

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
    store_programs(place / "programs")
    jax.config.update("jax_compilation_cache_dir", str(place))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    if reset_cache is not None:  # earlier compilations initialised the cache without a folder
        reset_cache()
    return place
