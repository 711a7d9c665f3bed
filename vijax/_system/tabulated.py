"""Loads by tables: a record in time, and a wave form that repeats."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Numbers, Reals, as_float
from .._jax.concrete import concrete
from .._printing import describe_tabulated, describe_waveform
from .checks import FINITE, POSITIVE, RISING, Rule, check_number, check_one
from .load import AbstractLoad, with_more_columns
from .splines import KINDS, derivatives_at_knots

_IN_PERIOD = Rule(lambda a: (a >= 0) & (a < 2 * np.pi), every="Every swept `{name}` must lie in [0, 2 pi).")


class AbstractTable(AbstractLoad):
    """A load by a table of values at knots, in time or in its phase."""

    values: eqx.AbstractVar[Float[Array, "knots n ..."]]

    def num_columns(self, lane_axes: int = 0) -> int:
        """Number of masses; lanes may be last."""
        return self.values.shape[self.values.ndim - lane_axes - 1]

    def size(self) -> Reals:
        """Largest value of every mass, (n,); lanes may be last."""
        return abs(self.values).max(axis=0)

    def with_more(self, count: int) -> "AbstractTable":
        """The load, zero on some more coordinates."""
        return eqx.tree_at(lambda load: load.values, self, with_more_columns(self.values, count))


class Tabulated(AbstractTable):
    """A load by a table of values in time: a record of an earthquake, a pulse, a step.

    It is zero before the first time and from the last time on, so a first or last value that is not zero is a jump. At a
    knot the load has its value after it. The motion stays exact: between knots the load is a polynomial.

    Derivatives by `times` and `values` are exact. Where an impact falls exactly on a knot they are one-sided.

    Args:
        times: times of the knots, rising, (knots,), two or more.
        values: force on every mass at these times, (knots, n); (knots,) for one column.
        kind: "linear" between the knots; "previous", steps, each value up to the next time (the last value is not used);
            "cubic", a spline with two continuous derivatives and a third at the last but one knots on both sides
            (not-a-knot): of two knots a line, of three a parabola.
        from_base: whether this is the inertia force -m_i y'' of a base that moves, as `vx.base_excitation` makes it: the
            quantity "max_absolute_acceleration" then has the acceleration y'' of the base.

    Raises:
        ValueError: for shapes that do not fit together, fewer than two knots, times that do not rise, numbers that are not
            finite, or an unknown kind.

    Example:
        ```python
        import vijax as vx
        pulse = vx.Tabulated([0.0, 0.5, 1.0], [[0.0], [3.0], [0.0]])
        system = vx.ImpactSystem([1.0], [[0.1]], [[4.0]], pulse, [vx.Stop(0, 0.2, "upper", 0.7)])
        ```

    References:
        C. de Boor, A Practical Guide to Splines (1978), Ch. IV.
    """

    times: Float[Array, "knots ..."]
    values: Float[Array, "knots n ..."]
    kind: str = eqx.field(static=True)
    from_base: bool = eqx.field(static=True)

    def __init__(self, times: Numbers, values: Numbers, kind: str = "linear", *, from_base: bool = False):
        self.times, self.values = as_float(times, "times"), _of_masses(values)
        self.kind, self.from_base = kind, bool(from_base)

    def __check_init__(self):
        _check_table("times", self.times, self.values, self.kind)

    @property
    def frequency(self) -> np.ndarray:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Zero, as a table has no frequency."""
        return np.zeros(self.times.shape[1:], self.times.dtype)

    @property
    def why_not_periodic(self) -> str:
        """Reason why there is no forcing period, and what to do."""
        return (
            "A `vx.Tabulated` load does not repeat, so there is no forcing period: follow the motion in time with `vx.simulate` or "
            "`vx.sweep(..., duration=...)`, or give the load as a `vx.Waveform`."
        )

    def check_lanes(self, check_every: Callable[[str, Any, Rule], None]) -> None:
        """Reject times that do not rise, of many machines at once; lanes last."""
        check_every("times", self.times, RISING)

    def derivatives(self) -> Reals:
        """Derivatives of the load by time where each interval begins, (knots - 1, orders, n); lanes may be last."""
        return derivatives_at_knots(self.times, self.values, self.kind)

    __repr__, _repr_html_ = described_by(describe_tabulated)


class Waveform(AbstractTable):
    """A periodic load by a table of values over one period: a square wave, a triangle, a measured cycle.

    The force on the masses at the time t is that of the table at the phase W t modulo 2 pi. Below the first phase the
    wave goes on from the last. At a knot the load has its value after it. The motion stays exact: between knots the load is
    a polynomial.

    The period of the machine is 2 pi / W, as with `vx.Harmonic`. Derivatives by `phases`, `values` and `frequency` are
    exact. Where an impact falls exactly on a knot they are one-sided.

    Args:
        phases: phases of the knots in radians, rising in [0, 2 pi), (knots,), two or more.
        values: force on every mass at these phases, (knots, n); (knots,) for one column.
        frequency: angular frequency W, positive, in radians per time.
        kind: "linear" between the knots; "previous", steps, as of a square wave; "cubic", a periodic spline with two
            continuous derivatives.
        from_base: whether this is the inertia force -m_i y'' of a base that moves, as `vx.base_excitation` makes it: the
            quantity "max_absolute_acceleration" then has the acceleration y'' of the base.

    Raises:
        ValueError: for shapes that do not fit together, fewer than two knots, phases that do not rise or lie outside
            [0, 2 pi), numbers that are not finite, or an unknown kind.

    Example:
        ```python
        import numpy as np, vijax as vx
        square = vx.Waveform([0.0, np.pi], [[1.0], [-1.0]], frequency=0.8, kind="previous")
        system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], square, [vx.Stop(0, 0.5, "upper", 0.7)])
        ```

    References:
        C. de Boor, A Practical Guide to Splines (1978), Ch. IV.
    """

    phases: Float[Array, "knots ..."]
    values: Float[Array, "knots n ..."]
    frequency: Float[Array, "..."]  # None in a sum whose loads share one
    kind: str = eqx.field(static=True)
    from_base: bool = eqx.field(static=True)

    def __init__(
        self,
        phases: Numbers,
        values: Numbers,
        frequency: ArrayLike,
        kind: str = "linear",
        *,
        from_base: bool = False,
    ):
        self.phases, self.values = as_float(phases, "phases"), _of_masses(values)
        self.frequency = as_float(frequency, "frequency")
        self.kind, self.from_base = kind, bool(from_base)

    def __check_init__(self):
        _check_table("phases", self.phases, self.values, self.kind)
        known = concrete(self.phases)
        if known is not None and not ((known >= 0) & (known < 2 * np.pi)).all():
            raise ValueError(
                f"Argument `phases` must lie in [0, 2 pi), but reaches from {known.min():.6g} to {known.max():.6g}: leave out the "
                "end of the period, where the first value follows."
            )
        if self.frequency is not None:
            check_number("frequency", self.frequency, POSITIVE)

    def check_lanes(self, check_every: Callable[[str, Any, Rule], None]) -> None:
        """Reject phases that do not rise within a period, and frequencies that are not positive; lanes last."""
        check_every("phases", self.phases, RISING)
        check_every("phases", self.phases, _IN_PERIOD)
        if self.frequency is not None:
            check_every("frequency", self.frequency, POSITIVE)

    def derivatives(self) -> Reals:
        """Derivatives of the load by its phase where each interval begins, (knots, orders, n); lanes may be last."""
        return derivatives_at_knots(self.phases, self.values, self.kind, 2 * np.pi)

    __repr__, _repr_html_ = described_by(describe_waveform)


def _of_masses(values: Numbers) -> Array:
    """Values with a column for every mass."""
    array = as_float(values, "values")
    return array[:, None] if array.ndim == 1 else array


def _check_table(name: str, knots: Array, values: Array, kind: str) -> None:
    """Reject a table of wrong shapes or values; `name` is that of its knots."""
    if not isinstance(kind, str) or kind not in KINDS:
        known = ", ".join(repr(one) for one in KINDS)
        raise ValueError(f"Argument `kind` must be one of {known}, but is {kind!r}.")
    if knots.ndim != 1:
        raise ValueError(f"Argument `{name}` must have shape (knots,), but has shape {knots.shape}.")
    if values.ndim != 2 or len(values) != len(knots) or not values.shape[1]:
        raise ValueError(
            f"Argument `values` must have shape (knots, n), a row of forces on all masses for each of the {len(knots)} `{name}`, "
            f"but has shape {values.shape}."
        )
    if len(knots) < 2:
        raise ValueError(
            f"Argument `{name}` must have two knots or more, but has {len(knots)}: a constant load is the `mean` of a `vx.Harmonic`."
        )
    check_one(name, knots, FINITE)
    check_one("values", values, FINITE)
    known = concrete(knots)
    if known is not None and not (np.diff(known) > 0).all():
        place = int(np.argmax(~(np.diff(known) > 0)))
        raise ValueError(
            f"Argument `{name}` must rise from knot to knot, but knot {place + 1} ({known[place + 1]:.6g}) does not lie behind knot "
            f'{place} ({known[place]:.6g}): a jump is two knots close together, or the kind "previous".'
        )
