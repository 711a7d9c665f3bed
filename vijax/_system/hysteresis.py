"""Jenkins elements: a spring in series with a dry slider.

The stretch e = row . x - slider of the spring is a first-order state: e' = row . v while the slider sticks, and e is
constant while it slips. So the engine has one more coordinate for each element, of which the velocity alone counts, as
for the states of `states.py`: e is its velocity, its mass is the stiffness k, and

    C = [[C, k row^T], [-k row, 0]]

couples it to the masses. It is skew, so the norm in which steps are bounded is that of the energy, 1/2 k e^2. While an element
slips its row of C is zero. (Rejected: sliders as a third kind of unknown beside positions and velocities, in each formula
of flows, derivatives, cycles and branches.)
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._descriptions import described_by
from .._jax.arrays import Count, Reals, array_namespace, as_float, stack, whole_number
from .._printing import describe_hysteresis
from .checks import FINITE, NOT_NEGATIVE, POSITIVE, Rule, check_number
from .contact import check_row, row_by_mass, row_of


class Jenkins(eqx.Module):
    """A spring in series with a dry slider along a combination of coordinates: hysteresis of joints and friction dampers.

    The element acts on the masses with -row S, S = stiffness * (row . x - z), |S| <= limit. While |S| < limit its slider z
    sticks: it is a spring. At the limit the slider slips: S stays, and z follows the masses until row . v = 0. Several in
    parallel are an Iwan model, see `vx.models.iwan`.

    The log numbers these elements after stops and friction: element k is `len(stops) + len(friction) + k`. It has a `vx.SLIP`
    where the slider begins to slip, and a `vx.STICK` where it stops: at row . v = 0, or at an impact that turns row . v. An
    element of limit 0 has both at once.

    A solution has the sliders at its end as `sliders1`, and forces and sliders at any time by `hysteresis_force` and
    `evaluate_sliders`. Where a whole state counts, in sweeps, orbits, maps and branches, each element is one more coordinate
    behind those of the machine, a first-order state: its position is 0, its velocity the stretch row . x - z. There `x0` and
    `v0` may also have entries for it; without, the element starts with its `slider`. Each adds two Floquet multipliers: 0,
    and one that is also 0 after a slip within the cycle.

    Args:
        row: the coefficient of each mass that it concerns, `{mass: coefficient}`, counted from 0; or the number of a
            mass, for `{mass: 1.0}`.
        stiffness: k, of the spring, positive.
        limit: F, magnitude of the force at which the slider slips, not negative.
        slider: z at the start, a length along the row; where the spring is unloaded if left out. One farther than
            limit / stiffness from row . x has slipped until it is as near.

    Raises:
        ValueError: for a row without entries or of zeros, a negative mass, a stiffness that is not positive, or a limit that
            is negative or not finite.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.5], frequency=0.9)
        joint = vx.Jenkins(0, stiffness=1.0, limit=0.3)
        system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, hysteresis=[joint])
        sol = vx.simulate(system, 0.0, 50.0)
        ```

    References:
        G. M. Jenkins, Proc. IEE 109 (1962); W. D. Iwan, J. Appl. Mech. 33 (1966), 893-900.
    """

    masses: tuple[int, ...] = eqx.field(static=True)
    row: Float[Array, "..."]
    stiffness: Float[Array, "..."]
    limit: Float[Array, "..."]
    slider: Float[Array, "..."] | None

    def __init__(
        self,
        row: Mapping[int, ArrayLike] | Count,
        stiffness: ArrayLike,
        limit: ArrayLike,
        slider: ArrayLike | None = None,
    ):
        is_row = isinstance(row, Mapping)
        self.masses, self.row = row_of("the element", row if is_row else {whole_number("row", row): 1.0})
        self.stiffness = as_float(stiffness, "stiffness")
        self.limit = as_float(limit, "limit")
        self.slider = None if slider is None else as_float(slider, "slider")

    def __check_init__(self):
        check_row(self.masses, self.row)
        self.check_law("", check_number)

    def check_law(self, name: str, check: Callable[[str, Any, Rule], None]) -> None:
        """Check its numbers, by `check_number`, or by `check_every` where lanes are last; `name` is a prefix."""
        check(f"{name}stiffness", self.stiffness, POSITIVE)
        check(f"{name}limit", self.limit, NOT_NEGATIVE)
        if self.slider is not None:
            check(f"{name}slider", self.slider, FINITE)

    __repr__, _repr_html_ = described_by(describe_hysteresis)

    coefficients = property(row_by_mass)

    @property
    def reach(self) -> Reals:
        """Largest stretch of the spring, F / k."""
        return self.limit / self.stiffness

    def along(self, x: Reals) -> Reals:
        """Positions or velocities of the masses along the row; lanes may be last."""
        return sum(a * x[i] for i, a in self.coefficients.items())

    def stretch_at(self, x: Reals) -> Reals:
        """Stretch of the spring at a start; lanes may be last."""
        along = self.along(x)
        if self.slider is None:
            return 0 * along
        library = array_namespace(along, self.slider, self.reach)
        return library.clip(along - self.slider, -self.reach, self.reach)


def with_stretches(elements: tuple[Jenkins, ...], num_masses: int, x: Reals, v: Reals) -> tuple[Reals, Reals]:
    """Start of all coordinates from that of the masses; one of all coordinates is as it is. Lanes may be last."""
    if not elements or (len(x) != num_masses and len(v) != num_masses):
        return x, v
    stretches = stack([element.stretch_at(x) for element in elements])
    if len(x) == num_masses:
        x = _joined([x, 0 * stretches], 0, 1)
    return x, v if len(v) != num_masses else _joined([v, stretches], 0, 1)


def coupled(
    elements: tuple[Jenkins, ...], mass: Reals, damping: Reals, stiffness: Reals
) -> tuple[Reals, Reals, Reals]:
    """Mass, damping and stiffness with one more coordinate for each element, all sticking; lanes may be last."""
    if not elements:
        return mass, damping, stiffness
    n, m = len(stiffness), len(elements)
    zero = 0 * stiffness[0, 0] + 0 * damping[0, 0]
    own = stack([element.stiffness + zero for element in elements])
    rows = stack(
        [
            stack([element.stiffness * element.coefficients.get(i, 0) + zero for i in range(n)])
            for element in elements
        ]
    )
    has_full_mass = mass.ndim == stiffness.ndim
    masses = _bordered(mass, own) if has_full_mass else _joined([mass, own], 0, 1)
    below = _joined([0 - rows, np.zeros((m, m, *[1] * zero.ndim), zero.dtype)], 1)
    beside = _joined([damping, _transposed(rows)], 1)
    return masses, _joined([beside, below], 0), _bordered(stiffness, 0 * own)


class ForceBesideSliders(eqx.Module):
    """Force of a machine with Jenkins elements, as a function of all coordinates; it is zero on the stretches.

    Attributes:
        force: of time, positions and velocities of the masses.
        count: number of elements.
    """

    force: Callable
    count: int = eqx.field(static=True)

    def __call__(self, t: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"]) -> Array:
        n = len(x) - self.count
        return jnp.concatenate([self.force(t, x[:n], v[:n]), jnp.zeros(self.count, x.dtype)])


def with_more_rows(a: Reals, count: int, axis: int) -> Reals:
    """Array with as many more rows, of zeros, along an axis; lanes may be last."""
    shape = list(a.shape)
    shape[axis] = count
    library = array_namespace(a)
    return library.concatenate([a, library.zeros(shape, a.dtype)], axis=axis)


def _bordered(matrix: Reals, diagonal: Reals) -> Reals:
    """Matrix with more rows and columns that are zero but for a diagonal."""
    count = len(diagonal)
    unit = np.eye(count, dtype=matrix.dtype).reshape(count, count, *[1] * (diagonal.ndim - 1))
    none = np.zeros((len(matrix), count, *[1] * (matrix.ndim - 2)), matrix.dtype)
    above, below = _joined([matrix, none], 1), _joined([_transposed(none), unit * diagonal[None]], 1)
    return _joined([above, below], 0)


def _transposed(matrix: Reals) -> Reals:
    return array_namespace(matrix).swapaxes(matrix, 0, 1)


def _joined(parts: list, axis: int, own: int = 2) -> Reals:
    """Parts with as many own axes side by side, in all lanes of any of them."""
    library = array_namespace(*parts)
    lanes = np.broadcast_shapes(*(part.shape[own:] for part in parts))
    whole = [library.broadcast_to(part, (*part.shape[:own], *lanes)) for part in parts]
    return library.concatenate(whole, axis=axis)
