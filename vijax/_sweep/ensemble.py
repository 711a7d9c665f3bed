"""Ensembles: a machine whose numbers are uncertain, as a labelled dataset of samples."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from .._dataset_attributes import variable_attributes
from .._execution.points import LaneInput
from .._execution.settings import DEFAULT_SETTINGS, ExecutionSettings
from .._flow.interface import AbstractFlow
from .._jax.arrays import Count, Numbers
from .._progress import says_what_compiles, tqdm
from .._system.parameters import find_parameter
from .._system.system import AnySystem, machine_of, varied
from .counts import RECORD, TRANSIENT, counts_of
from .distributions import Distributions, drawn, uncertain
from .grid import base_of
from .outcomes import warn_of_endings
from .quantities import checked_quantities
from .random_numbers import Rng, generator_of
from .short_names import with_labels, with_names
from .unsettled import warn_of_unsettled_points
from .zipped import sweep_zipped

SAMPLE = "sample"


@says_what_compiles
def ensemble(
    system: AnySystem,
    distributions: Distributions,
    *,
    samples: Count = 256,
    rng: Rng | None = None,
    seed: Count | None = None,
    correlation: Numbers | None = None,
    transient: Count = TRANSIENT,
    record: Count = RECORD,
    duration: Numbers | None = None,
    ts: Numbers | None = None,
    x0: Numbers | None = None,
    v0: Numbers | None = None,
    flow: AbstractFlow | None = None,
    args: object = None,
    lyapunov: bool = False,
    quantities: Sequence[str] = (),
    max_impacts: Count = 2048,
    max_steps: Count | None = None,
    executor: object = None,
    progress: bool = True,
    settings: ExecutionSettings = DEFAULT_SETTINGS,
) -> xr.Dataset:
    """Run samples of a machine whose numbers are uncertain.

    The numbers of all samples are drawn at once, as a scrambled Sobol sequence, which fills the space of the uncertain
    quantities more evenly than random numbers do: the error of a mean falls nearly as 1 / samples where the result is
    smooth, and never more slowly than 1 / sqrt(samples). Powers of two are most even.

    Args:
        system: the machine, or a `vx.Family` of machines.
        distributions: for each uncertain number, by its path as in `vx.sweep`, its distribution: of `scipy.stats`, or any
            with `ppf`, `mean` and `std`. "stops[*].restitution" is one number for all stops; "x0[0]" is a start. A pair of
            path and distribution gives a short name, `{"r": ("stops[*].restitution", scipy.stats.uniform(0.6, 0.2))}`.
        samples: number of samples.
        rng: of the scrambling: a whole number, or a `Generator`, `BitGenerator` or
            `SeedSequence` of NumPy, as in SPEC 7; 0 if left out, so that a call can be repeated.
        seed: older name of `rng` for a whole number.
        correlation: correlation matrix of the quantities, in their order, each transformed to a normal distribution
            (a Gaussian copula); of normal distributions their own. Independent if left out.
        transient: as for `vx.sweep`.
        record: likewise.
        duration: likewise.
        ts: likewise.
        x0: likewise.
        v0: likewise.
        flow: likewise.
        args: likewise.
        lyapunov: likewise.
        quantities: likewise.
        max_impacts: likewise.
        max_steps: likewise.
        executor: likewise.
        progress: show a progress bar.
        settings: as for `vx.sweep`.

    Returns:
        The dataset of `vx.sweep` along `sample`, with the sampled values as coordinates, and `x0` and `v0`
        (sample, mass), the starts. What takes a sweep takes it: `vx.classify`, `vx.periodic_orbits`, `vx.system_of`.

    Raises:
        ValueError: for a path that names nothing or an array, something that is no distribution, a sampled value that
            makes no valid machine (bound the distribution, as `scipy.stats.truncnorm` does), and as `vx.sweep`.
        KeyboardInterrupt: after Ctrl-C; nothing is kept.

    Example:
        ```python
        import scipy.stats, vijax as vx
        known = {"r": ("stops[*].restitution", scipy.stats.uniform(0.6, 0.2))}
        ds = vx.ensemble(vx.models.wagg_bishop_a(0.8), known, samples=64)
        print(float(ds.impact_velocity.std()))
        ```

    References:
        I. M. Sobol', USSR Comput. Math. Math. Phys. 7 (1967) 86; A. B. Owen, J. Complexity 14 (1998) 466.
    """
    base = base_of(varied(system, args), x0, v0)
    known = uncertain(distributions, base, correlation)
    values = drawn(known, samples, generator_of(rng, seed))
    limits = {"max_impacts": max_impacts, "max_steps": max_steps}
    counts = counts_of(base.system, transient, record, duration, ts, lyapunov=lyapunov, **limits)
    added = checked_quantities(quantities, machine_of(base.system), counts)
    of_machine, states = _apart(base, values)
    with tqdm(total=len(states), unit="sample", disable=not progress) as bar:
        ds = sweep_zipped(
            base.system,
            of_machine,
            states,
            counts,
            flow,
            settings,
            executor,
            bar.update,
            along=SAMPLE,
            quantities=added,
        )
    of_samples = {path: (SAMPLE, a, variable_attributes(path)) for path, a in values.items()}
    ds = with_labels(with_names(ds.assign_coords(of_samples), known.names), base.system)
    warn_of_endings(ds, "max_impacts_reached", "max_steps_reached", "non_finite", "friction_paradox")
    warn_of_unsettled_points(ds)
    return ds


def _apart(base: LaneInput, values: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The sampled numbers of the machine, and the starts of the samples, (samples, 2 n)."""
    count = len(next(iter(values.values())))
    starts = {name: np.tile(getattr(base, name), (count, 1)) for name in ("x0", "v0")}
    of_machine = {}
    for path, a in values.items():
        name = path.split("[")[0]
        if name in starts:
            starts[name][:, find_parameter(base, path).index[0]] = a
        else:
            of_machine[path] = a
    return of_machine, np.concatenate([starts["x0"], starts["v0"]], axis=1)
