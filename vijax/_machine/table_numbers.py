"""Numbers of loads by tables: knots and the polynomials between them."""

import equinox as eqx
import numpy as np

from .._jax.arrays import Reals, array_namespace
from .._system.shared_records import SharedRecords
from .._system.system import ImpactSystem
from .._system.tabulated import Tabulated, Waveform

# Kinds of loads by tables.
_BY_TABLES = (Tabulated, Waveform, SharedRecords)


class TableNumbers(eqx.Module):
    """Numbers of a load by a table, lanes last, padded to a power of two.

    Attributes:
        knots: where each row begins, (rows, ...): times, or phases of a wave form; infinite where padded. The first row of
            a table in time is the zero load before it.
        rows: derivatives of the load where each row begins, (rows, orders, n, ...), by time, or by phase.
        count: number of rows of a wave form, after which the first follows; of a table in time, that of all rows.
        frequency: angular frequency of a wave form that counts its own periods; None of others.
        is_wave: whether it is a wave form.
        size: number of rows of a table. Where lanes share several, these stand one after another.
        number: number of the table of each lane, (...); None where there is one for all, or one for each.
    """

    knots: Reals
    rows: Reals
    count: Reals
    frequency: Reals | None
    is_wave: bool = eqx.field(static=True)
    size: int = eqx.field(static=True)
    number: Reals | None = None

    @property
    def is_in_step(self) -> bool:
        """True for a wave form of the frequency of the machine."""
        return self.is_wave and self.frequency is None


def is_by_tables(system: ImpactSystem) -> bool:
    """True where a load of a machine is given by a table."""
    return any(isinstance(load, _BY_TABLES) for load in system.forcing.loads)


def tables_of(system: ImpactSystem) -> tuple[TableNumbers, ...] | None:
    """Numbers of all loads by tables; None if there are none."""
    loads = [load for load in system.forcing.loads if isinstance(load, _BY_TABLES)]
    if not loads:
        return None
    orders = 4 if any(load.kind == "cubic" for load in loads) else 2
    is_own = system.forcing.why_not_periodic
    return tuple(
        _one_after_another(load, orders)
        if isinstance(load, SharedRecords)
        else _numbers_of(load, orders, system.forcing.clock, is_own=bool(is_own))
        for load in loads
    )


def _one_after_another(load: SharedRecords, orders: int) -> TableNumbers:
    """Tables that lanes share, padded to a power of two."""
    of_each = _numbers_of(load.tables, orders, load.frequency, is_own=True)
    count = of_each.rows.shape[-1]
    which = np.minimum(np.arange(1 << (count - 1).bit_length()), count - 1)

    def stacked(a: Reals) -> np.ndarray:
        own = np.broadcast_to(a, (*a.shape[:-1], count))[..., which]
        return np.moveaxis(own, -1, 0).reshape(-1, *a.shape[1:-1], 1)

    knots, rows = stacked(of_each.knots), stacked(of_each.rows)
    return TableNumbers(knots, rows, of_each.count, None, False, of_each.size, load.number)


def _numbers_of(load: Tabulated | Waveform, orders: int, clock: Reals, *, is_own: bool) -> TableNumbers:
    is_wave = isinstance(load, Waveform)
    knots, rows = load.phases if is_wave else load.times, load.derivatives()
    library = array_namespace(knots, rows)
    none = 0 * rows[:1]
    count = len(rows)
    if not is_wave:  # before the table, and after it
        knots = library.concatenate([knots[:1] - 1, knots])
        rows = library.concatenate([none, rows, none])
    size = 1 << (len(rows) + (0 if is_wave else 1) - 1).bit_length()
    far = library.full((size - len(knots), *knots.shape[1:]), np.inf, knots.dtype)
    empty = library.broadcast_to(none, (size - len(rows), *rows.shape[1:]))
    rows = library.concatenate([rows, empty])
    higher = library.broadcast_to(0 * rows[:, :1], (size, orders - rows.shape[1], *rows.shape[2:]))
    has_frequency = is_wave and is_own and load.frequency is not clock
    return TableNumbers(
        knots=library.concatenate([knots, far]),
        rows=library.concatenate([rows, higher], axis=1),
        count=np.full([1] * (knots.ndim - 1), count if is_wave else size, knots.dtype),
        frequency=load.frequency if has_frequency else None,
        is_wave=is_wave,
        size=size,
    )
