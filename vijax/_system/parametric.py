"""Stiffness and damping that change periodically in time, as forces on the masses.

A machine keeps them inside its `force`, beside that of the user, so all that holds for forces holds for them.
"""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._jax.arrays import Numbers, as_float, in_full_precision
from .._jax.concrete import concrete
from .checks import check_finite
from .forcing import Harmonic
from .load import AbstractLoad

_NO_FREQUENCY = "Argument `parametric` has no `frequency`, and there is no load whose frequency it could have: give it one."


class Parametric(eqx.Module):
    """Periodic stiffness and damping of a machine: K(t) = K + sum_h K_h cos(h W t + p_h), and C(t) likewise.

    They add the force -(K(t) - K) x - (C(t) - C) x' to the masses. So the machine is linear, but not of constant
    coefficients, and moves by `vx.TaylorFlow`: a meshing gear, a cracked rotor, a pendulum on a shaken pivot, Mathieu's
    equation.

    Args:
        stiffness: K_h of the harmonics h = 1, 2, ..., shape (harmonics, n, n), or (n, n) of the first one alone; any matrices.
        damping: C_h likewise; there may be another number of them.
        frequency: W, in radians per time; that of the load if left out. A machine without a load gets it as that of its
            forcing period.
        phase: p_h in radians, of stiffness and damping alike, shape (harmonics,) of the larger number of harmonics; zero if left out.

    Raises:
        ValueError: for wrong shapes, values that are not finite, or a frequency that is not positive.

    Example:
        ```python
        import vijax as vx
        # x'' + 0.1 x' + (1 - 0.4 cos 2 t) x = 0 above a stop
        swing = vx.ImpactSystem(
            [1.0], [[0.1]], [[1.0]], stops=[vx.Stop(0, -0.5, "lower", 0.8)],
            parametric=vx.Parametric(stiffness=[[[-0.4]]], frequency=2.0),
        )
        sol = vx.simulate(swing, 0.0, 30.0, x0=[0.1])
        ```

    References:
        A. H. Nayfeh & D. T. Mook, Nonlinear Oscillations (1979), Ch. 5.
    """

    stiffness: Float[Array, "..."] | None
    damping: Float[Array, "..."] | None
    frequency: Float[Array, "..."] | None
    phase: Float[Array, "..."]

    def __init__(
        self,
        stiffness: Numbers | None = None,
        damping: Numbers | None = None,
        frequency: Numbers | None = None,
        phase: Numbers | None = None,
    ):
        of = lambda a, name: in_full_precision(as_float(a, name))  # noqa: E731
        self.stiffness = None if stiffness is None else of(stiffness, "stiffness")
        self.damping = None if damping is None else of(damping, "damping")
        self.frequency = None if frequency is None else of(frequency, "frequency")
        given = [len(a) if a.ndim == 3 else 1 for _, a in self._matrices()]
        self.phase = of(np.zeros(max(given, default=0)) if phase is None else phase, "phase")

    def __check_init__(self):
        matrices = list(self._matrices())
        if not matrices:
            raise ValueError("`vx.Parametric` needs `stiffness` or `damping`: matrices of the harmonics.")
        for name, a in matrices:
            if a.ndim not in (2, 3) or not a.size or a.shape[-1] != a.shape[-2]:
                raise ValueError(
                    f"Argument `{name}` must have shape (harmonics, n, n), or (n, n) for one harmonic, but has shape {a.shape}."
                )
            if (known := concrete(a)) is not None:
                check_finite(name, known)
        if len({a.shape[-1] for _, a in matrices}) > 1:
            raise ValueError("Arguments `stiffness` and `damping` must have matrices of the same size.")
        most = max(len(a) if a.ndim == 3 else 1 for _, a in matrices)
        if self.phase.shape != (most,):
            raise ValueError(f"Argument `phase` must have shape ({most},), but has shape {self.phase.shape}.")
        if (known := concrete(self.phase)) is not None:
            check_finite("phase", known)
        frequency = None if self.frequency is None else concrete(self.frequency)
        if self.frequency is not None and self.frequency.ndim:
            raise ValueError(
                f"Argument `frequency` must be one number, but has shape {self.frequency.shape}."
            )
        if frequency is not None and not 0 < frequency < np.inf:
            raise ValueError(f"Argument `frequency` must be positive, but is {frequency}.")

    def _matrices(self) -> Iterator[tuple[str, Any]]:
        """Names and values of what is given."""
        for name in ("stiffness", "damping"):
            if (a := getattr(self, name)) is not None:
                yield name, a

    @property
    def num_masses(self) -> int:
        """Number of masses, n."""
        return next(a.shape[-1] for _, a in self._matrices())

    def __call__(self, t: Float[Array, ""], x: Float[Array, " n"], v: Float[Array, " n"]) -> Array:
        """Force on the masses."""
        assert self.frequency is not None
        angle, total = self.frequency * t, jnp.zeros_like(x)
        waves = [jnp.cos((h + 1) * angle + self.phase[h]) for h in range(len(self.phase))]
        for matrices, moving in ((self.stiffness, x), (self.damping, v)):
            if matrices is None:
                continue
            harmonics = matrices if matrices.ndim == 3 else matrices[None]
            own = list(zip(waves, harmonics, strict=False))
            # The fewest products of two series: one for each harmonic and mass, or one for each entry of K(t).
            if len(own) < self.num_masses:
                total = total - sum(wave * (matrix @ moving) for wave, matrix in own)
            else:
                total = total - sum(wave * matrix for wave, matrix in own) @ moving
        return total


class ParametricForce(eqx.Module):
    """Parametric terms beside the force of the user.

    Attributes:
        force: of the user; None if there is none.
        parametric: the terms; without a frequency they have that of the load, see `force_of`.
    """

    force: Callable | None
    parametric: Parametric

    def __call__(self, t: Array, x: Array, v: Array, args: PyTree) -> Array:
        own = self.parametric(t, x, v)
        return own if self.force is None else own + jnp.asarray(self.force(t, x, v, args), x.dtype)


def load_and_terms(forcing: Any, parametric: Any, num_masses: int) -> tuple[AbstractLoad, Parametric | None]:
    """The load, and the parametric terms; without a load, one of no amplitude has their frequency."""
    if not isinstance(parametric, Parametric | None):
        raise ValueError(f"Argument `parametric` must be a `vx.Parametric`, but is {parametric!r}.")
    if forcing is not None:
        return forcing, parametric
    none, is_none = np.zeros(num_masses), lambda leaf: leaf is None
    if parametric is None:
        return Harmonic(none, 0.0), None
    if parametric.frequency is None:
        raise ValueError(_NO_FREQUENCY)
    # One place for the frequency: a change there moves the forcing period as well.
    return Harmonic(none, parametric.frequency), eqx.tree_at(
        lambda p: p.frequency, parametric, None, is_leaf=is_none
    )


def check_terms(terms: Parametric | None, num_masses: int, forcing: AbstractLoad) -> None:
    """Reject terms of another number of masses, or without a frequency that could be theirs."""
    if terms is None:
        return
    if terms.num_masses != num_masses:
        raise ValueError(
            f"Argument `parametric` has matrices of {terms.num_masses} masses, but the machine has {num_masses}."
        )
    if terms.frequency is not None:
        return
    known = concrete(forcing.clock)
    if forcing.why_not_periodic or (known is not None and not known.any()):
        raise ValueError(f"{_NO_FREQUENCY} {forcing.why_not_periodic}".rstrip())
