"""Message to a process that makes programs: the machine, the calls, and the settings under which they will be made.

A program belongs to settings of JAX, a folder, and an order of folders in which modules are looked for. The other
process has to have the same.
"""

import io
import pickle
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import jax

from .._jax.program_store import store_programs
from .._system.system import AnySystem

# Settings of JAX that decide what is compiled, or where.
_SETTINGS = "jax_enable_x64", "jax_default_matmul_precision", "jax_platforms"


class _Shipment(NamedTuple):
    """Settings of JAX, folder of programs, names of calls, and the machine, pickled by itself."""

    settings: dict[str, Any]
    folder: str
    calls: tuple[str, ...]
    machine: bytes


def packed_shipment(machine: AnySystem, calls: tuple[str, ...], folder: Path) -> bytes:
    """Machine, calls and settings as the bytes that the process reads.

    Raises:
        ValueError: if the machine has a function or class that another process cannot import.
    """
    settings = {name: getattr(jax.config, name) for name in _SETTINGS}
    return pickle.dumps(tuple(_Shipment(settings, str(folder.absolute()), calls, _pickled(machine))))


def unpacked_shipment(data: bytes) -> tuple[AnySystem, tuple[str, ...]]:
    """The machine and the calls, in a process that has taken on the settings."""
    shipment = _Shipment(*pickle.loads(data))
    for name, value in shipment.settings.items():
        jax.config.update(name, value)
    jax.config.update(
        "jax_enable_compilation_cache", False
    )  # what JAX loads from its own cache cannot be stored
    store_programs(Path(shipment.folder))
    return pickle.loads(shipment.machine), shipment.calls


def _pickled(machine: AnySystem) -> bytes:
    file = io.BytesIO()
    try:
        _Pickler(file).dump(machine)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(
            f"Argument `machine` of `vx.precompile` goes to another process, which cannot import a part of it ({error}): put the "
            "function of its `force`, or of the family, into a module of its own, a file, and import it from there. A "
            "function of a notebook or of the script itself, within another function, or a lambda cannot be found."
        ) from error
    return file.getvalue()


class _Pickler(pickle.Pickler):
    """Refuses what stands in the script or notebook itself."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, FunctionType | type) and obj.__module__ == "__main__":
            raise pickle.PicklingError(f"`{obj.__qualname__}` is defined in the script or notebook itself")
        return NotImplemented
