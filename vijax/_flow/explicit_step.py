"""One step of an explicit Runge-Kutta method of diffrax, with its stages unrolled.

`solver.step` of diffrax stores the slopes in one array and loops over the stages, each of which combines the whole
array. Over lanes that took two to three times as long as these sums, which omit zero coefficients and compute every
slope separately. The coefficients are those of diffrax, its dense output is a matrix.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .._jax.arrays import Scalar, add_up
from .._jax.xla import compute_once
from .bernstein import nodes

# Size of coefficients of a dense output that are rounding errors of zero.
_NONE = 1e-14


def explicit_step(
    solver: Any, field: Callable[[Scalar, PyTree], PyTree], zero: PyTree, step: Scalar, degree: int
) -> tuple[PyTree, PyTree, list[PyTree]]:
    """Take a step from zero.

    Args:
        solver: the method.
        field: slopes at a time and point, computed separately from the surrounding code.
        zero: start of the step.
        step: its length.
        degree: degree of the polynomial inside.

    Returns:
        End of the step, its estimated error, and the points at the nodes of `bernstein.py`.
    """
    tableau = solver.tableau
    slopes = [field(jnp.zeros_like(step), zero)]
    for part, row in zip(tableau.c, tableau.a_lower, strict=True):
        slopes.append(field(float(part) * step, _combined(row, slopes, step)))
    inside = _dense(type(solver).interpolation_cls, tuple(np.asarray(tableau.b_sol).tolist()), degree)
    rows = tuple(tuple(np.asarray(row).tolist()) for row in (tableau.b_sol, tableau.b_error, *inside))
    end, error, *between = compute_once(_all_combined, rows, slopes, step)
    return end, error, between


def _all_combined(rows, slopes: list[PyTree], step: Scalar) -> list[PyTree]:
    return [_combined(row, slopes, step) for row in rows]


def _combined(row: Sequence[float] | np.ndarray, slopes: list[PyTree], step: Scalar) -> PyTree:
    """Weighted sum of slopes, times the step."""
    used = [(float(weight), slope) for weight, slope in zip(row, slopes, strict=True) if weight != 0]
    if not used:
        return jax.tree.map(jnp.zeros_like, slopes[0])
    weights, trees = zip(*used, strict=True)
    return jax.tree.map(lambda *k: step * add_up([w * a for w, a in zip(weights, k, strict=True)]), *trees)


@cache
def _dense(interpolation: Callable, ends: tuple[float, ...], degree: int) -> np.ndarray:
    """Matrix from slopes to the dense output at the nodes, (nodes, stages)."""

    def of_one(slope: jax.Array) -> jax.Array:
        path = interpolation(t0=0.0, t1=1.0, y0=jnp.zeros(()), y1=jnp.dot(jnp.asarray(ends), slope), k=slope)
        return jax.vmap(path.evaluate)(jnp.asarray(nodes(degree)))

    with jax.ensure_compile_time_eval():
        matrix = np.asarray(jax.jit(jax.vmap(of_one, out_axes=1))(jnp.eye(len(ends))))
    return np.where(np.abs(matrix) > _NONE, matrix, 0)
