"""Jenkins elements in parallel: models of joints and friction dampers."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import ArrayLike

from .._jax.arrays import Count, Numbers, as_float
from .._system.hysteresis import Jenkins


def iwan(row: Mapping[int, ArrayLike] | Count, stiffnesses: Numbers, limits: Numbers) -> list[Jenkins]:
    """Make the elements of an Iwan model: Jenkins elements in parallel along one row.

    Together they are a spring of stiffness sum k as long as none slips, soften as one after the other reaches its limit, and
    carry at most sum F. Equal stiffnesses with limits spread evenly are Iwan's uniform distribution.

    Args:
        row: the coefficient of each mass that they concern, `{mass: coefficient}`, or the number of a mass; see
            `vx.Jenkins`.
        stiffnesses: k of each, (elements,), positive.
        limits: F of each, (elements,), not negative.

    Returns:
        The elements, for `vx.ImpactSystem(..., hysteresis=...)`.

    Raises:
        ValueError: for lists of different lengths, or as `vx.Jenkins` does.

    Example:
        ```python
        import numpy as np, vijax as vx
        joint = vx.models.iwan(0, np.full(10, 0.1), np.linspace(0.01, 0.1, 10))
        load = vx.Harmonic(amplitude=[0.3], frequency=0.9)
        system = vx.ImpactSystem([1.0], [[0.02]], [[1.0]], load, hysteresis=joint)
        ```

    References:
        W. D. Iwan, "A distributed-element model for hysteresis and its steady-state dynamic response", J. Applied Mechanics
        33 (1966) 893-900.
    """
    k, f = as_float(stiffnesses, "stiffnesses"), as_float(limits, "limits")
    if k.ndim != 1 or k.shape != f.shape or not k.size:
        raise ValueError(
            "Arguments `stiffnesses` and `limits` must have one entry for each element, shape (elements,), but have shapes "
            f"{np.shape(k)} and {np.shape(f)}."
        )
    return [Jenkins(row, one, limit) for one, limit in zip(k, f, strict=True)]
