"""The machine: masses, dampers, springs, the load and the stops."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._printing import as_html, as_text, told_of_system
from .._refusal import checked
from .._types import Numbers, as_float, concrete, in_full_precision
from .checks import POSITIVE, check_one, check_semidefinite, check_slots
from .force import as_force, bind, name_of_force
from .forcing import Harmonic
from .stop import Stop


class ImpactSystem(eqx.Module):
    """A machine with stops: M x'' + C x' + K x = f(t) + force(t, x, x', args) while every gap is open.

    Args:
        mass: the lumped masses, the diagonal of M, shape (n,), positive.
        damping: C, shape (n, n), symmetric positive semi-definite.
        stiffness: K, shape (n, n), symmetric positive semi-definite.
        forcing: the periodic load f(t).
        stops: any number of stops, at most one on each side of a mass.
        force: what else acts on the masses, a smooth JAX function of the time (a number), positions and
            velocities (n,) and the `args` given to `simulate` or `sweep`, which returns (n,): an
            `eqx.Module`, whose numbers are parameters of the machine, or a plain function. A machine that
            has one is not linear, and is simulated by `DiffraxFlow`. Stroboscopic maps and sweeps need
            one that depends on t with the period of the load, or not at all.

    Raises:
        ValueError: with the argument and the remedy, for wrong shapes or values. Values are
            checked where they are known, not while they are traced.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[1.0], frequency=2.8)
        wall = vx.Stop(mass=0, position=0.0, side="upper", restitution=0.8)
        system = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], load, [wall])
        ```

    References:
        Wagg & Bishop (2004), Eq. 3.
    """

    mass: Float[Array, " n"]
    damping: Float[Array, "n n"]
    stiffness: Float[Array, "n n"]
    forcing: Harmonic
    stops: tuple[Stop, ...]
    force: Callable | None

    def __init__(
        self,
        mass: Numbers,
        damping: Numbers,
        stiffness: Numbers,
        forcing: Harmonic,
        stops: Sequence[Stop] = (),
        force: Any = None,
    ):
        self.mass = as_float(mass)
        self.damping = as_float(damping)
        self.stiffness = as_float(stiffness)
        self.forcing, self.stops = _of_one_frequency(*in_full_precision((forcing, tuple(stops))))
        self.force = as_force(force)

    def __check_init__(self):
        if self.mass.ndim != 1 or self.mass.size == 0:
            raise ValueError(f"Argument `mass` must have shape (n,), but has shape {self.mass.shape}.")
        n = self.mass.size
        for name in ("damping", "stiffness"):
            shape = getattr(self, name).shape
            if shape != (n, n):
                raise ValueError(f"Argument `{name}` must have shape ({n}, {n}), but has shape {shape}.")
        if self.forcing.amplitude.shape[-1] != n:
            raise ValueError(
                f"`forcing.amplitude` must end in the number of masses, {n}, "
                f"but has shape {self.forcing.amplitude.shape}."
            )
        self._check_stops()
        self._check_values()

    def _check_stops(self):
        places: dict[tuple[int, str], int] = {}
        for j, stop in enumerate(self.stops):
            if stop.mass >= self.num_masses:
                raise ValueError(
                    f"`stops[{j}].mass` is {stop.mass}, but the machine has masses 0 to "
                    f"{self.num_masses - 1}."
                )
            if (stop.mass, stop.side) in places:
                raise ValueError(
                    f"`stops[{places[stop.mass, stop.side]}]` and `stops[{j}]` are both {stop.side} stops "
                    f"of mass {stop.mass}: keep the nearer one."
                )
            places[stop.mass, stop.side] = j
        check_slots(self.stops)

    def _check_values(self):
        check_one("mass", self.mass, POSITIVE)
        for name in ("damping", "stiffness"):
            matrix = concrete(getattr(self, name))
            if matrix is not None:
                check_semidefinite(name, matrix)

    def __repr__(self) -> str:
        return as_text(told_of_system, self, name_of_force)

    def _repr_html_(self) -> str:
        return as_html(told_of_system, self, name_of_force)

    @property
    def num_masses(self) -> int:
        """Number of masses, n."""
        return self.mass.shape[0]

    @property
    def num_stops(self) -> int:
        """Number of stops."""
        return len(self.stops)


def _of_one_frequency(forcing: Harmonic, stops: Sequence[Stop]) -> tuple[Harmonic, tuple[Stop, ...]]:
    """Leave the frequency to the load alone, so that a change there is one everywhere."""
    same = []
    for j, stop in enumerate(stops):
        if stop.motion is not None and stop.motion.frequency is not None:
            differs = stop.motion.frequency != forcing.frequency
            sentence = f"The frequency of `stops[{j}].motion` must be that of the load, `forcing.frequency`."
            known = concrete(differs)
            if known is not None and known.any():
                raise ValueError(sentence)
            if known is None and stop.motion.frequency is not forcing.frequency:
                sure = checked(forcing.frequency, differs.astype(int), ("", sentence))
                forcing = eqx.tree_at(lambda f: f.frequency, forcing, sure)
            stop = eqx.tree_at(lambda s: s.motion.frequency, stop, None)
        same.append(stop)
    return forcing, tuple(same)


def check_again(system: ImpactSystem) -> None:
    """Refuse a machine whose numbers were replaced by invalid ones after it was built."""
    for part in (system.forcing, *system.stops, system):
        part.__check_init__()


def with_args(system: ImpactSystem, args: object) -> ImpactSystem:
    """The machine with its force bound to `args`, in full precision.

    For the force see `bind`. Stops lose a frequency that they were given after the machine was built.
    """
    system = in_full_precision(system)
    if any(stop.motion is not None and stop.motion.frequency is not None for stop in system.stops):
        same = _of_one_frequency(system.forcing, system.stops)
        system = eqx.tree_at(lambda s: (s.forcing, s.stops), system, same)
    force = bind(system.force, args, system.num_masses)
    return system if force is None else eqx.tree_at(lambda s: s.force, system, force)


def chain(
    masses: Numbers,
    dampings: Numbers,
    stiffnesses: Numbers,
    forcing: Harmonic,
    stops: Sequence[Stop] = (),
    force: Any = None,
) -> ImpactSystem:
    """Build a chain of masses: wall, spring and damper, mass, spring and damper, mass, ...

    Spring and damper i join mass i to mass i - 1, the first of them to the wall; the last mass is
    free on its far side (Wagg & Bishop 2004, Fig. 1).

    Args:
        masses: m, length n.
        dampings: c, length n.
        stiffnesses: k, length n.
        forcing: the periodic load.
        stops: the stops.
        force: what else acts on the masses, see `ImpactSystem`.

    Returns:
        The machine, with the matrices of Eqs. 1 and 2.

    Raises:
        ValueError: if the three sequences differ in length.

    Example:
        ```python
        import vijax as vx
        load = vx.Harmonic(amplitude=[0.3, 0.0], frequency=0.8)
        system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, [vx.Stop(0, 0.3, "upper", 0.7)])
        ```

    References:
        Wagg & Bishop (2004), Eqs. 1-2.
    """
    mass, damping, stiffness = (as_float(a) for a in (masses, dampings, stiffnesses))
    for name, values in (("masses", mass), ("dampings", damping), ("stiffnesses", stiffness)):
        if values.shape != (mass.size,):
            raise ValueError(
                f"Argument `{name}` must have one entry per mass, shape ({mass.size},), "
                f"but has shape {values.shape}."
            )
    return ImpactSystem(mass, _chain_matrix(damping), _chain_matrix(stiffness), forcing, stops, force)


def _chain_matrix(links: Float[Array, " n"]) -> Float[Array, "n n"]:
    """The matrix of n links in a row, [E] of Eq. 5 for equal links."""
    known = concrete(links)
    if known is None:
        after = jnp.append(links[1:], 0)
        return jnp.diag(links + after) - jnp.diag(links[1:], 1) - jnp.diag(links[1:], -1)
    after = np.append(known[1:], known.dtype.type(0))
    return as_float(np.diag(known + after) - np.diag(known[1:], 1) - np.diag(known[1:], -1))
