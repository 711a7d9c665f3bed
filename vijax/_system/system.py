"""The machine: masses, dampers, springs, the load, stops and contacts."""

import abc
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from .._descriptions import described_by
from .._jax.arrays import Numbers, a_kind_of, as_float, in_full_precision, whole_number
from .._jax.concrete import concrete
from .._printing import describe_system
from .checks import (
    POSITIVE,
    check_finite,
    check_mass_matrices,
    check_one,
    move_alike,
)
from .contact import Contact
from .force import (
    BoundForce,
    as_force,
    bind_args,
    force_of,
    name_of_force,
    parametric_of,
    with_parametric,
)
from .friction import Friction
from .hysteresis import Jenkins, with_stretches
from .load import AbstractLoad, LoadSum
from .painleve import check_slip
from .parametric import Parametric, check_terms, load_and_terms
from .parts import AnyStop, check_friction, check_parts, check_rows, check_stops, forces_of, of_one_frequency
from .symmetry import Symmetry
from .symmetry_search import symmetries_of


class ImpactSystem(eqx.Module):
    """A machine with stops: M x'' + C x' + K x = f(t) + force(t, x, x', args) while every gap is open.

    Args:
        mass: the lumped masses, the diagonal of M, shape (n,), positive; or M itself, shape (n, n), symmetric
            positive definite.
        damping: C, shape (n, n), any matrix: gyroscopic forces make it asymmetric, negative damping indefinite.
        stiffness: K, shape (n, n), any matrix: follower forces and feedback make it asymmetric, a buckled beam
            indefinite. Symmetric, positive semi-definite matrices are the fastest.
        forcing: the load f(t), a `vx.Harmonic`, `vx.Waveform` or `vx.Tabulated`, or a sum of such, as in `load + other`; None
            if there is none. Such a machine has no forcing period, which sweeps, orbits and maps need: give it a load whose
            amplitudes are 0 to choose one.
        stops: any number of `vx.Stop`, at most one on each side of a mass, `vx.Contact`, `vx.CompliantStop` and
            `vx.CompliantContact`, in any mixture; results number them in this order.
        force: any other force on the masses, a smooth JAX function of the time (a number), positions and velocities
            (n,) and the `args` given to `simulate` or `sweep`, which returns (n,): an `eqx.Module`, whose numbers are
            parameters of the machine, or a plain function. A machine with a force is nonlinear, and moves by
            `TaylorFlow`, or by `DiffraxFlow` where the force has no Taylor series. Stroboscopic maps and sweeps need a
            force that depends on t with the period of the load, or not at all.
        friction: any number of `vx.Friction`; event logs number them in this order after the stops.
        hysteresis: any number of `vx.Jenkins`; event logs number them in this order after friction.
        num_states: number of last coordinates of which the velocity alone counts: first-order states, such as a voltage,
            see `vx.with_states`. Their columns of K are zero, their positions are 0 in all results.
        parametric: stiffness and damping that change periodically in time, a `vx.Parametric`.

    Raises:
        ValueError: with the argument and the remedy, for wrong shapes or values. Traced values are not checked.

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

    mass: Float[Array, "..."]
    damping: Float[Array, "n n"]
    stiffness: Float[Array, "n n"]
    forcing: Any  # an `AbstractLoad`, of which type checkers do not see the kind
    stops: tuple[AnyStop, ...]
    force: Callable | None
    friction: tuple[Friction, ...]
    hysteresis: tuple[Jenkins, ...]
    num_states: int = eqx.field(static=True)

    def __init__(
        self,
        mass: Numbers,
        damping: Numbers,
        stiffness: Numbers,
        forcing: AbstractLoad | None = None,
        stops: Sequence[AnyStop] = (),
        force: Any = None,
        friction: Sequence[Friction] = (),
        num_states: int = 0,
        hysteresis: Sequence[Jenkins] = (),
        parametric: Parametric | None = None,
    ):
        self.num_states = whole_number("num_states", num_states, 0)
        self.mass = as_float(mass, "mass")
        self.damping = as_float(damping, "damping")
        self.stiffness = as_float(stiffness, "stiffness")
        if not self.mass.size or not self.mass.ndim:
            raise ValueError(
                f"Argument `mass` must have shape (n,) or (n, n), but has shape {self.mass.shape}."
            )
        forcing, parametric = load_and_terms(forcing, parametric, self.mass.shape[0])
        if isinstance(force, list | tuple):
            raise ValueError(
                f"Argument `force`, behind `stops`, must be a function force(t, x, v, args), but is {force!r}: give friction by "
                "its name, `friction=[...]`."
            )
        check_parts(forcing, stops, friction, hysteresis)
        self.forcing, self.stops = of_one_frequency(*in_full_precision((forcing, tuple(stops))))
        self.force = with_parametric(as_force(force), parametric)
        self.friction = in_full_precision(tuple(friction))
        self.hysteresis = in_full_precision(tuple(hysteresis))

    def __check_init__(self):
        n = len(self.mass) if self.mass.ndim else 0
        if self.mass.shape not in ((n,), (n, n)) or n == 0:
            raise ValueError(
                f"Argument `mass` must have shape (n,) or (n, n), but has shape {self.mass.shape}."
            )
        for name in ("damping", "stiffness"):
            shape = getattr(self, name).shape
            if shape != (n, n):
                raise ValueError(f"Argument `{name}` must have shape ({n}, {n}), but has shape {shape}.")
        for path, values in forces_of(self.forcing):
            if values.shape[-1] != n:
                raise ValueError(
                    f"`{path}` must end in the number of masses, {n}, but has shape {values.shape}."
                )
        check_stops(self.stops, n)
        check_friction(self.friction, len(self.stops), n)
        check_rows("hysteresis", self.hysteresis, n)
        check_terms(parametric_of(self.force), n, self.forcing)
        self._check_values()
        if self.num_states:
            self._check_states()
        check_slip(self)

    def _check_states(self):
        first = self.num_masses - self.num_states
        if first < 1:
            raise ValueError(
                f"Argument `num_states` is {self.num_states}, but of {self.num_masses} coordinates one at least must be a mass."
            )
        for name in ("stops", "friction", "hysteresis"):
            elements = getattr(self, name)
            for j, element in enumerate(elements):
                if max(element.coefficients) >= first:
                    raise ValueError(
                        f"`{name}[{j}]` acts on coordinate {max(element.coefficients)}, which is a state."
                    )
        stiffness = concrete(self.stiffness)
        if stiffness is not None and stiffness[:, first:].any():
            raise ValueError(
                f"The last {self.num_states} columns of `stiffness` must be zero: of a first-order state the velocity alone counts."
            )

    def _check_values(self):
        if self.mass.ndim == 1:
            check_one("mass", self.mass, POSITIVE)
        elif (matrix := concrete(self.mass)) is not None:
            check_mass_matrices(matrix)
        for name in ("damping", "stiffness"):
            matrix = concrete(getattr(self, name))
            if matrix is not None:
                check_finite(name, matrix)

    __repr__, _repr_html_ = described_by(describe_system, name_of_force)

    @property
    def num_masses(self) -> int:
        """Number of masses, or of coordinates, n."""
        return self.mass.shape[0]

    @property
    def num_coordinates(self) -> int:
        """Number of coordinates in the engine, which are those of the machine and one for each Jenkins element."""
        return self.num_masses + len(self.hysteresis)

    def start_of(self, x: Any, v: Any) -> tuple[Any, Any]:
        """Start of all coordinates, from that of the machine or of all; lanes may be last."""
        return with_stretches(self.hysteresis, self.num_masses, x, v)

    @property
    def is_state(self) -> np.ndarray:
        """Flags of the coordinates that are first-order states, (n,)."""
        return np.arange(self.num_masses) >= self.num_masses - self.num_states

    @property
    def parametric(self) -> Parametric | None:
        """Stiffness and damping that change in time; None if there are none."""
        return parametric_of(force_of(self))

    @property
    def has_full_mass(self) -> bool:
        """True if `mass` is a matrix; lanes may be last."""
        return self.mass.ndim == self.stiffness.ndim

    @property
    def is_coupled(self) -> bool:
        """True if contacts may share inertia, or stops of one mass may move differently; lanes may be last.

        Stops that move differently have no common frame of reference. If False, every contact acts on one mass alone,
        in a frame that moves with its stops, and all is simpler and faster.
        """
        has_contacts = any(isinstance(stop, Contact) for stop in self.stops)
        return has_contacts or self.is_switching or self.has_full_mass or not move_alike(self.stops)

    @property
    def is_switching(self) -> bool:
        """True if there are friction, Jenkins elements or compliant stops, so that forces switch between linear laws."""
        return bool(self.friction) or bool(self.hysteresis) or any(stop.is_compliant for stop in self.stops)

    @property
    def num_stops(self) -> int:
        """Number of stops."""
        return len(self.stops)

    def symmetries(self, *, args: object = None) -> tuple[Symmetry, ...]:
        """Find the symmetries of the machine: maps of its motions to others, by exchange and mirror images of its masses.

        A mass between two equal stops, for instance, under a harmonic load: with x(t) also -x(t + T / 2) is a motion. Numbers
        count as equal up to rounding. A `force` is compared at random states and times; so is a load.

        Args:
            args: of the `force`, as for `simulate`.

        Returns:
            All of them but the identity, see `vx.Symmetry`; none if the machine has none.

        Raises:
            ValueError: if the numbers of the machine are traced, or if it has too many symmetries, as of equal masses that
                nothing couples.

        Example:
            ```python
            import vijax as vx
            stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
            machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 2.0), stops)
            machine.symmetries()  # x0 -> -x0, half a period later
            ```

        References:
            M. Golubitsky, I. Stewart & D. G. Schaeffer, Singularities and Groups in Bifurcation Theory II (1988), Ch. XVI.
        """
        return symmetries_of(self, args)


class AbstractFamily(eqx.Module):
    """Machines as a function of values, see `family.py`; its attributes are those of the machine at its values."""

    @property
    @abc.abstractmethod
    def bound_system(self) -> ImpactSystem:
        """The machine at the values, its force bound to its `args`."""

    @property
    def system(self) -> ImpactSystem:
        """The machine at the values."""
        return unbound(self.bound_system)

    @property
    @abc.abstractmethod
    def values(self) -> dict[str, Any]:
        """Values by their names."""

    def __getattr__(self, name: str) -> Any:
        if name in _OF_MACHINES:
            return getattr(self.system, name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


# Public attributes of machines, which families have too.
_OF_MACHINES = frozenset(
    name for name in (*ImpactSystem.__dataclass_fields__, *vars(ImpactSystem)) if not name.startswith("_")
)
# Where a machine stands, and a family may.
AnySystem = ImpactSystem | AbstractFamily


def mass_matrix(mass: Any) -> np.ndarray:
    """Mass matrix, (n, n), from itself or its diagonal."""
    mass = np.asarray(mass)
    return np.diag(mass) if mass.ndim == 1 else mass


def machine_of(system: AnySystem) -> ImpactSystem:
    """The machine itself, or that of a family at its values, whose force is bound; nothing else is accepted."""
    machine = system.bound_system if isinstance(system, AbstractFamily) else system
    if not isinstance(machine, ImpactSystem):
        raise ValueError(
            f"Argument `system` must be one machine, a `vx.ImpactSystem`, but is {a_kind_of(system)}: call this for each "
            "machine, or sweep the numbers in which they differ."
        )
    return machine


def is_linear(system: ImpactSystem) -> bool:
    """True if all forces are linear between impacts: without a `force`, friction and compliant stops."""
    return system.force is None and not system.is_switching


def check_again(system: ImpactSystem) -> None:
    """Reject a machine whose numbers were replaced by invalid ones after it was built."""
    loads = system.forcing.loads if isinstance(system.forcing, LoadSum) else ()
    terms = parametric_of(system.force)
    parts = *system.stops, *system.friction, *system.hysteresis, *(() if terms is None else (terms,))
    for part in (system.forcing, *loads, *parts, system):
        for kind in type(part).__mro__:  # as Equinox does at construction
            if "__check_init__" in vars(kind):
                vars(kind)["__check_init__"](part)


def with_args(system: AnySystem, args: object) -> ImpactSystem:
    """Machine, or that of a family, with its force bound to `args`, in full precision.

    For the force see `bind_args`. Frequencies that stops were given after the machine was built are removed.
    """
    system = in_full_precision(machine_of(system))
    if any(stop.motion is not None and stop.motion.frequency is not None for stop in system.stops):
        same = of_one_frequency(system.forcing, system.stops)
        system = eqx.tree_at(lambda s: (s.forcing, s.stops), system, same)
    return bound(system, args)


def varied(system: AnySystem, args: object) -> AnySystem:
    """Owner of the parameters: a family as it is, or a machine with its force bound to `args`.

    Raises:
        ValueError: for a family with `args`, which would be parameters beside its own.
    """
    if not isinstance(system, AbstractFamily):
        return with_args(system, args)
    if args is not None:
        raise ValueError(
            "Argument `args` is for machines: let the function of the family give its `force` these numbers."
        )
    return in_full_precision(system)


def bound(system: Any, args: object = None) -> Any:
    """Machine with its force bound to `args`, or to those that it has; all else, and a family, is unchanged."""
    if isinstance(system, AbstractFamily):
        return system
    force = bind_args(system.force, args, system.num_masses)
    return system if force is None else eqx.tree_at(lambda s: s.force, system, force)


def unbound(system: Any) -> Any:
    """Machine with its force as the user gave it, if that has no `args`; a family is unchanged."""
    if isinstance(system, AbstractFamily):
        return system
    force = system.force
    if not isinstance(force, BoundForce) or force.args is not None:
        return system
    return eqx.tree_at(lambda s: s.force, system, force.force)
