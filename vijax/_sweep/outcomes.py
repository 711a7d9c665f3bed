"""Warnings of points that did not end as they should."""

import warnings

import xarray as xr

from .._trajectory.solution import RESULTS

_NAMES = list(RESULTS._name_to_item)


def warn_of_endings(ds: xr.Dataset, *names: str) -> None:
    """Warn, once for each of some results, how many points have it. The warning points to the caller's caller.

    Args:
        ds: what `sweep` returned, or a part of it.
        names: of members of `RESULTS`, whose messages say what to do.
    """
    if ds.attrs.get("max_impacts") == 0:  # no log was wanted
        names = tuple(name for name in names if name != "max_impacts_reached")
    for name in names:
        count = int((ds["result"] == code_of(name)).sum())
        if count:
            message = RESULTS[getattr(RESULTS, name)]
            warnings.warn(f"{count} of {ds['result'].size} points ended with {message}", stacklevel=3)


def warn_of_unsettled(count: int, of: int, transient: int) -> None:
    """Warn of starts of which it is not known where they lead. The warning points to the caller's caller.

    Args:
        count: of them.
        of: so many starts.
        transient: forcing periods, as they were asked for.
    """
    if count:
        warnings.warn(
            f"{count} of {of} starts have not settled, even run on for many times the transient: they may be in "
            f"chaos that dies out slowly, or near a bifurcation. Increase `transient`, now {transient}.",
            stacklevel=3,
        )


def code_of(name: str) -> int:
    """The number by which a dataset tells a result."""
    return _NAMES.index(name)
