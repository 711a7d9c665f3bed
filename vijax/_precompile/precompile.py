"""Programs made ahead of time, in a process of its own."""

from collections.abc import Sequence

from .._jax.program_store import ProgramStore, program_store
from .._system.system import AnySystem, machine_of
from .process import Precompilation
from .shipment import packed_shipment

# Calls for which programs can be made, by the names of the functions.
CALLS = (
    "simulate",
    "sweep",
    "periodic_orbit",
    "continuation",
    "bifurcation_curve",
    "basins",
    "lyapunov_exponents",
)


def precompile(machine: AnySystem, calls: Sequence[str] | str, wait: bool = False) -> Precompilation:
    """Compile ahead of time what calls will need for this kind of machine, in a process of its own.

    The first call of each kind compiles for seconds, a first branch for half a minute. Begun in the first cell of a
    notebook, this is done by the time at which the call comes. The process runs at low priority and fills the folder of
    stored programs; see `vx.keep_compiled`. A call that comes earlier waits for the program that is being made and
    makes the others itself: no program is compiled twice. Programs serve all machines with as many masses, stops and
    other elements of each kind, at any values. Those of an orbit, a branch or a curve also depend on its number of
    events: they are made for the orbit on which the machine settles from rest.

    Args:
        machine: the machine, or a `vx.Family`. The function of a family, and a `force`, must stand in a module that
            another process can import.
        calls: their names, some of "simulate", "sweep", "periodic_orbit", "continuation", "bifurcation_curve", "basins" and
            "lyapunov_exponents"; programs are made for their usual options.
        wait: return when all is done.

    Returns:
        The process: `wait()` waits for its end, `stop()` ends it, `is_running` tells whether it still works.

    Raises:
        ValueError: for an unknown call, or a function that another process cannot import.
        RuntimeError: if programs are not stored: the folder cannot be written, `VIJAX_PROGRAMS=off`, or no CPU is used.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_a(0.8)
        vx.precompile(system, ["simulate", "sweep", "continuation"])
        ```
    """
    machine_of(machine)
    names = checked_calls(calls)
    store = writable_store()
    found = Precompilation(names, packed_shipment(machine, names, store.folder))
    if wait:
        found.wait()
    return found


def checked_calls(calls: Sequence[str] | str) -> tuple[str, ...]:
    """Names of calls without repetition.

    Raises:
        ValueError: for an unknown one, or none.
    """
    names = dict.fromkeys([calls] if isinstance(calls, str) else calls)
    unknown = [name for name in names if name not in CALLS]
    if unknown or not names:
        raise ValueError(
            f"Argument `calls` must name some of {', '.join(CALLS)}, but {'is empty' if not names else f'has {unknown[0]!r}'}."
        )
    return tuple(names)


def writable_store() -> ProgramStore:
    """The store of programs.

    Raises:
        RuntimeError: if there is none, or its folder cannot be written.
    """
    store = program_store()
    if store is None or not store.can_write():
        place = (
            "the environment or the device allows none"
            if store is None
            else f"{store.folder} cannot be written"
        )
        raise RuntimeError(
            f"Programs made ahead of time need a folder, but {place}: name another one by `vx.keep_compiled(folder)` or the "
            "environment variable VIJAX_PROGRAMS, on a CPU."
        )
    return store
