"""Mean, standard deviation and sensitivity of a number of a machine, by its derivatives."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from .._jax.arrays import Numbers, as_float
from .._jax.concrete import is_traced
from .._jax.xla import padding_allowed
from .._system.parameters import set_parameter
from .._system.system import AnySystem, ImpactSystem, machine_of
from .distributions import Distributions, moments, uncertain


@padding_allowed
def sensitivity(
    function: Callable[[ImpactSystem], Any],
    system: AnySystem,
    distributions: Distributions,
    *,
    correlation: Numbers | None = None,
) -> xr.Dataset:
    """Estimate the uncertainty of a result of a machine, to first order, by a single derivative.

    At the means m of the uncertain quantities, with their covariance C and the gradient g of the function f there, the
    mean is f(m) and the variance g C g. Exact where f is linear. `vx.ensemble` shows what is left out, above all
    where the sequence of impacts changes within the spread of the quantities.

    Args:
        function: takes the machine and returns a number by operations of JAX: by `vx.simulate`, `vx.stroboscopic_map` or
            `vx.periodic_orbit`, for instance.
        system: the machine, or a `vx.Family` of machines.
        distributions: as for `vx.ensemble`, of numbers of the machine; their means and standard deviations are used.
        correlation: correlation matrix of the quantities, in their order; independent if left out.

    Returns:
        `value`, f(m); `std`, the standard deviation; along `quantity`, by short name or path: `mean` and `deviation` of the
        quantity, `derivative` of f by it, and `contribution`, |derivative| times deviation, what f would deviate by if
        that quantity alone were uncertain.

    Raises:
        ValueError: if the function returns no single number, or numbers are traced; and as `vx.ensemble`.

    Example:
        ```python
        import scipy.stats, vijax as vx
        later = lambda machine: vx.simulate(machine, 0.0, 20.0).x1[0]
        known = {"stops[*].restitution": scipy.stats.norm(0.7, 0.01), "mass[0]": scipy.stats.norm(1.0, 0.02)}
        vx.sensitivity(later, vx.models.wagg_bishop_a(0.8), known).contribution
        ```

    References:
        A. Saltelli et al., Global Sensitivity Analysis: The Primer (2008), Sec. 1.2.
    """
    if is_traced(system):
        raise ValueError("`sensitivity` needs known numbers: call it outside of `jax.jit` and `jax.vmap`.")
    known = uncertain(distributions, system, correlation)
    mean, std = moments(known)

    def of_quantities(numbers: jax.Array) -> jax.Array:
        machine = system
        for path, number in zip(known.by_path, numbers, strict=True):
            machine = set_parameter(machine, path, number)
        value = as_float(function(machine_of(machine)))
        if value.ndim:
            raise ValueError(
                f"Argument `function` must return a single number, but its result has shape {value.shape}."
            )
        return value

    value, gradient = (np.asarray(a) for a in jax.value_and_grad(of_quantities)(jnp.asarray(mean)))
    spread = gradient * std
    columns = {"mean": mean, "deviation": std, "derivative": gradient, "contribution": np.abs(spread)}
    names = [known.names.get(path, path) for path in known.by_path]
    return xr.Dataset(
        {
            "value": ((), value, {"long_name": "value at the means"}),
            "std": ((), np.sqrt(spread @ known.correlation @ spread), {"long_name": "standard deviation"}),
            **{name: (("quantity",), a) for name, a in columns.items()},
        },
        coords={"quantity": np.array(names, np.dtypes.StringDType())},
    )
