"""Functions compiled once for each kind of arguments, in this process or in one before it."""

import enum
import threading
import weakref
from collections.abc import Callable
from functools import cached_property
from importlib.metadata import version
from operator import attrgetter
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.dtypes import canonicalize_dtype

from .announcing import Stage, announce
from .concrete import is_tracer
from .garbage import without_garbage_collection
from .memory_maps import make_room, note_holder, note_program
from .program_store import ProgramStore, StoredProgram, key_of, program_store


class _Leaf(enum.Enum):
    """Placeholder of an array among static leaves."""

    ARRAY = enum.auto()


_ARRAY = _Leaf.ARRAY


class _Static(NamedTuple):
    """All of a tree but its arrays.

    Attributes:
        structure: its structure.
        leaves: its leaves, with a placeholder for each array; empty if all are arrays.
    """

    structure: Any
    leaves: tuple

    def joined(self, arrays: Any) -> Any:
        """The tree with these arrays."""
        if not self.leaves:
            return jax.tree.unflatten(self.structure, arrays)
        given = iter(arrays)
        leaves = [next(given) if leaf is _ARRAY else leaf for leaf in self.leaves]
        return jax.tree.unflatten(self.structure, leaves)


class _Key(NamedTuple):
    """Kind of arguments: static part, shapes and types of the arrays that are kept and donated, settings of JAX."""

    static: _Static
    kept: tuple
    donated: tuple
    settings: tuple


_RELEASE = version("vijax").replace(".", "_")
# `_SETTINGS`: settings of JAX that change a program.
# `_UNUSUAL`: settings in which JAX must see each call.
_SETTINGS = attrgetter("jax_enable_x64", "jax_default_matmul_precision")
_UNUSUAL = attrgetter("jax_debug_nans", "jax_debug_infs", "jax_disable_jit")


class Programs:
    """Compiled programs of a function, one for each kind of arguments.

    Non-array leaves are static. They determine the structure of the result.

    Args:
        function: the function.
        options: returns the compiler's options; called late, as they depend on the backend, which no import may start.
        name: names all that the function depends on besides its arguments, see `key_of`. By default its module and
            name, if these determine it. Programs without a name are traced in each process, and stored by their text.
        donates_last: whether the arrays of the last argument are used up.
        static_numbers: whether Python numbers are static; if not, they are arrays.
    """

    def __init__(
        self,
        function: Callable,
        options: Callable[[], dict | None],
        *,
        name: Any = None,
        donates_last: bool = False,
        static_numbers: bool = True,
    ):
        self._function, self._options = function, options
        self._donates_last, self._static_numbers = donates_last, static_numbers
        self._name = _name_of(function) if name is None else name
        self._results: dict[_Static, _Static] = {}
        self._made: dict[_Key, tuple[Callable, _Static]] = {}
        self._prepared: weakref.WeakSet[PreparedCall] = weakref.WeakSet()
        note_holder(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        static, *parts = self._parts(args, kwargs)
        # Under `vmap` or `grad` alone JAX must transform the function.
        is_traced = any([is_tracer(a) for part in parts for a in part])
        store = None if is_traced or any(_UNUSUAL(jax.config)) else program_store()
        if store is None:
            return self._run_plainly(static, parts, is_traced=is_traced)
        run, results = self._found(_key(static, parts), store)
        return results.joined(run(*parts))

    def prepared(self, *args: Any) -> "PreparedCall":
        """The function of the arrays in these arguments, in the order of their leaves, for any others of their kinds."""
        call = PreparedCall(self, *self._parts(args, {}))
        self._prepared.add(call)
        return call

    def compiled(self, *args: Any, **kwargs: Any) -> Any:
        """The program for these arguments, compiled anew, for tests and benchmarks."""
        return self._plain.lower(*self._parts(args, kwargs)).compile()

    def drop(self) -> None:
        """Drop the programs of this process."""
        self._made.clear()
        for call in list(self._prepared):
            call.drop()

    def count(self) -> int:
        """Number of programs of this process."""
        return len(self._made) + self._plain._cache_size()

    def _parts(self, args: tuple, kwargs: dict) -> tuple[_Static, list, list]:
        """Static part of the arguments, arrays that are kept, arrays that are donated."""
        arrays, static = self._split((args, kwargs))
        donated = len(self._split(args[-1])[0]) if self._donates_last else 0
        num = len(arrays) - donated
        return static, arrays[:num], arrays[num:]

    def _split(self, tree: Any) -> tuple[list, _Static]:
        """Arrays of a tree, and all else."""
        leaves, structure = jax.tree.flatten(tree)
        is_array = [_is_array(leaf) for leaf in leaves]
        if all(is_array):
            return leaves, _Static(structure, ())
        if not self._static_numbers:
            leaves = [np.asarray(a) if isinstance(a, int | float | complex) else a for a in leaves]
            is_array = [_is_array(leaf) for leaf in leaves]
        arrays = [leaf for leaf, yes in zip(leaves, is_array, strict=True) if yes]
        others = [_ARRAY if yes else leaf for leaf, yes in zip(leaves, is_array, strict=True)]
        return arrays, _Static(structure, tuple(others) if len(arrays) < len(leaves) else ())

    def _run_plainly(self, static: _Static, parts: list[list], *, is_traced: bool = False) -> Any:
        """Call without the store."""
        make_room()
        if static not in self._results and not is_traced:
            announce(Stage.COMPILES_NOW)
        found = self._plain(static, *parts)
        return self._results[static].joined(found)

    def _found(self, key: _Key, store: ProgramStore) -> tuple[Callable, _Static]:
        return self._made.get(key) or self._make(key, store)

    def _make(self, key: _Key, store: ProgramStore) -> tuple[Callable, _Static]:
        """Load a program, or compile and store it."""
        make_room()
        name = None if self._name is None else key_of(self._name, self._options(), *key)
        found = self._named(key, store, name) if name is not None else self._by_text(key, store)
        self._made[key] = found.run, found.results
        return self._made[key]

    def _named(self, key: _Key, store: ProgramStore, name: str) -> StoredProgram:
        """Load a program by its name, or trace, compile and store it."""

        def make() -> StoredProgram:
            announce(Stage.COMPILES)
            lowered, results = self._lowered(key)
            run = _compiled(lowered, store, name, results)
            return StoredProgram(run, results)

        return _loaded_or_made(store, name, make)

    def _by_text(self, key: _Key, store: ProgramStore) -> StoredProgram:
        """Trace a program, and load it by its text or compile and store it."""
        announce(Stage.TRACES)
        lowered, results = self._lowered(key)
        name = key_of(*_text_of(lowered), self._options(), key.kept, key.donated)
        if name is None:
            return StoredProgram(lowered.compile(), results)
        # Programs of one text may differ in what are no arrays: their results are not stored.
        make = lambda: StoredProgram(_compiled(lowered, store, name, None), results)  # noqa: E731
        return _loaded_or_made(store, name, make)._replace(results=results)

    def _lowered(self, key: _Key) -> tuple[Any, _Static]:
        """A program that is traced and lowered, and the tree of its results."""
        # As JAX takes integers of NumPy where 64-bit numbers are off: asked for as they are, it warns of them.
        parts = [
            [jax.ShapeDtypeStruct(shape, canonicalize_dtype(dtype)) for shape, dtype in part]
            for part in (key.kept, key.donated)
        ]
        with without_garbage_collection():
            lowered = self._plain.trace(key.static, *parts).lower()
        return lowered, self._results[key.static]

    @cached_property
    def _plain(self) -> Any:
        def of_arrays(static: _Static, given: list, donated: list) -> list:
            return self._of_arrays(static, given, donated)

        # The release in the name keeps JAX's own cache from finding programs of another, see `_make`.
        of_arrays.__name__ = f"{getattr(self._function, '__name__', 'call')}_{_RELEASE}"
        return jax.jit(of_arrays, static_argnums=0, donate_argnums=2, compiler_options=self._options())

    def _of_arrays(self, static: _Static, given: list, donated: list) -> list:
        args, kwargs = static.joined([*given, *donated])
        arrays, self._results[static] = self._split(self._function(*args, **kwargs))
        return arrays


class PreparedCall:
    """Calls of a program with concrete arrays of one kind, all else of whose arguments was looked at once.

    Args:
        programs: the programs.
        static: static part of the arguments.
        kept: arrays of the arguments.
        donated: arrays that are used up.
    """

    def __init__(self, programs: Programs, static: _Static, kept: list, donated: list):
        self._programs, self._static, self._num = programs, static, len(kept)
        self._kinds = [jax.ShapeDtypeStruct(a.shape, a.dtype) for a in (*kept, *donated)]
        self._last: tuple | None = None

    def __call__(self, arrays: list) -> Any:
        """Result for these arrays, which nothing traces."""
        parts = [arrays[: self._num], arrays[self._num :]]
        store = None if any(_UNUSUAL(jax.config)) else program_store()
        if store is None:
            return self._programs._run_plainly(self._static, parts)
        state = _SETTINGS(jax.config), store
        if self._last is None or self._last[0] != state:
            kinds = [self._kinds[: self._num], self._kinds[self._num :]]
            self._last = state, *self._programs._found(_key(self._static, kinds), store)
        _, run, results = self._last
        return results.joined(run(*parts))

    def drop(self) -> None:
        """Drop the program, which takes room as long as anyone has it; the next call finds it again."""
        self._last = None


def _key(static: _Static, parts: list[list]) -> _Key:
    """Key of arguments by their arrays, or by what has their shapes and types."""
    kept, donated = (tuple([(a.shape, a.dtype) for a in part]) for part in parts)
    return _Key(static, kept, donated, _SETTINGS(jax.config))


# Whether values of a type are arrays, cached as in `concrete.py`.
_are_arrays: dict[type, bool] = {}


def _is_array(leaf: Any) -> bool:
    found = _are_arrays.get(type(leaf))
    if found is None:
        found = _are_arrays[type(leaf)] = isinstance(leaf, jax.Array | np.ndarray | np.generic)
    return found


def _text_of(lowered: Any) -> tuple[str, list[int]]:
    """Lowered text of a program, and the numbers of the arguments that are left in it: others that nothing reads are not.

    Functions of the first and of the second of two arguments have one text.
    """
    return lowered.as_text(), sorted(
        lowered._lowering.compile_args["kept_var_idx"]
    )  # JAX tells it nowhere else


def _loaded_or_made(store: ProgramStore, name: str, make: Callable[[], StoredProgram]) -> StoredProgram:
    """A program of the store; made, if nobody has made it, by one process or thread while the others wait."""
    if found := _load(store, name):
        return found
    with store.maker(name, lambda: announce(Stage.WAITS)):
        return _load(store, name) or make()


def _load(store: ProgramStore, name: str) -> StoredProgram | None:
    found = store.load(name)
    if found is not None:
        note_program()
    return found


def _compiled(lowered: Any, store: ProgramStore, name: str, results: Any) -> Callable:
    """A program, compiled and stored."""
    hits = _hits.count
    run = lowered.compile()
    # A program that JAX itself loaded from disk cannot be written again.
    if _hits.count == hits:
        store.save(name, run, results)
    return run


class _Hits(threading.local):
    """Number of programs that JAX has loaded from its own cache, in this thread."""

    count = 0


_hits = _Hits()


def _note_hit(event: str, **_: str | int) -> None:
    _hits.count += event == "/jax/compilation_cache/cache_hits"


jax.monitoring.register_event_listener(_note_hit)


def _name_of(function: Callable) -> tuple[str, str] | None:
    """Module and name of a function of this package; None if they do not determine it."""
    module, name = (str(getattr(function, key, "<none>")) for key in ("__module__", "__qualname__"))
    is_ours = module.partition(".")[0] == __name__.partition(".")[0]
    return (module, name) if is_ours and "<" not in name else None
