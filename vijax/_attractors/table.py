"""Attractors, and the attractors on which motions end, as a labelled dataset."""

import numpy as np
import xarray as xr

from .._dataset_attributes import flags
from .._sections.classify import MOTIONS
from .._sweep.dataset import labelled
from .attractor import Attractor
from .ensemble import Endpoints, Machines

ATTRACTOR = "attractor"
# Attributes of a sweep that belong to its points.
_OF_POINTS = ("x0", "v0", "carry", "carry_from", "max_impacts")
_FILL = {"motion": -1, "num_periods": 0, "is_stable": False}


def columns_of(machines: Machines, motions: list[Attractor]) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Variables of each attractor, with the names of their other dimensions."""
    n, count = machines.system.num_coordinates, len(motions)
    machine = np.array([motion.machine for motion in motions], int)
    dtype = machines.rate.dtype

    def rows(name: str, size: int, kind: type | np.dtype) -> np.ndarray:
        return np.array([getattr(motion, name) for motion in motions], kind).reshape(count, size)

    longest = max((len(motion.points) for motion in motions), default=0)
    section = np.full((count, longest, 2 * n), np.nan, dtype)
    for k, motion in enumerate(motions):
        section[k, : len(motion.points)] = motion.points / machines.scale(machine[k : k + 1])
    start = section[:, 0] if longest else np.zeros((count, 2 * n), dtype)
    multipliers = rows("multipliers", 2 * n, np.result_type(dtype, np.complex64))
    periods = np.array([motion.num_periods for motion in motions], int)
    num_stops = machines.system.num_stops
    exponents, exponents_error = exponents_of(machines, motions, multipliers, periods)
    return {
        "x0": (("mass",), start[:, :n]),
        "v0": (("mass",), start[:, n:]),
        "motion": ((), np.array([motion.kind for motion in motions], np.int8)),
        "num_periods": ((), periods),
        "num_impacts": (("stop",), rows("num_impacts", num_stops, float)),
        "held_time": (("stop",), rows("held_time", num_stops, dtype)),
        "multipliers": (("multiplier",), multipliers),
        "exponents": (("exponent",), exponents),
        "exponents_error": (("exponent",), exponents_error),
        "is_stable": ((), np.array([motion.is_stable for motion in motions], bool)),
        "residual": ((), np.array([motion.residual for motion in motions], dtype)),
        "section_x": (("section", "mass"), section[..., :n]),
        "section_v": (("section", "mass"), section[..., n:]),
    }


def exponents_of(
    machines: Machines, motions: list[Attractor], multipliers: np.ndarray, periods: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lyapunov exponents, largest first, (attractors, 2 n), and their errors.

    Those of a cycle are ln|mu| / (n T), without error; those of others are averaged along the motion.
    """
    period = 2 * np.pi / machines.rate[[motion.machine for motion in motions]] if motions else np.zeros(0)
    with np.errstate(divide="ignore"):
        exponents = np.log(np.abs(multipliers)) / (np.maximum(periods, 1) * period)[:, None]
    error = np.zeros_like(exponents)
    for k in np.flatnonzero(np.isnan(exponents).any(axis=1)):
        exponents[k], error[k] = machines.exponents(motions[k].points[0], motions[k].machine)
    return exponents, error


def share_statistics(labels: np.ndarray, count: int, of: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number of motions that end on each attractor, its share of `of` motions, and the binomial standard error."""
    counts = np.bincount(labels[labels >= 0], minlength=count)
    share = counts / of
    return counts, share, np.sqrt(share * (1 - share) / of)


def sorted_by_share(motions: list[Attractor], labels: np.ndarray) -> tuple[list[Attractor], np.ndarray]:
    """The attractors with the most motions first, and the labels in this order."""
    counts = np.bincount(labels[labels >= 0], minlength=len(motions))
    order = np.argsort(-counts, kind="stable")
    rank = np.append(np.argsort(order), -1)
    return [motions[k] for k in order], rank[labels]


def attractor_dataset(
    machines: Machines, motions: list[Attractor], labels: np.ndarray, is_failed: np.ndarray
) -> xr.Dataset:
    """The attractors along `attractor`, and the counts of motions that have none."""
    counts, share, error = share_statistics(labels, len(motions), len(labels))
    columns = {
        "share": ((), share),
        "share_error": ((), error),
        "num_starts": ((), counts),
        **columns_of(machines, motions),
    }
    ds = xr.Dataset({name: ((ATTRACTOR, *own), a) for name, (own, a) in columns.items()})
    ds["num_not_settled"] = ((), np.count_nonzero((labels < 0) & ~is_failed))
    ds["num_failed"] = ((), np.count_nonzero(is_failed))
    return _with_words(ds)


def table_along(
    machines: Machines,
    motions: list[Attractor],
    name: np.ndarray,
    goes_to: dict[int, int],
    labels: np.ndarray,
    ends: Endpoints,
) -> xr.Dataset:
    """As `attractor_dataset`, along a parameter.

    Args:
        machines: one for each value.
        motions: the attractors at all values.
        name: the number of each along the parameter.
        goes_to: the index of that on which each ends at the next value.
        labels: labels of the motions from the starts.
        ends: ends of these motions.
    """
    ((path, along),) = machines.values.items()
    value = np.array([motion.machine for motion in motions], int)
    shape = len(along), int(name.max(initial=-1)) + 1
    is_found = np.zeros(shape, bool)
    is_found[value, name] = True
    _, share, error = share_statistics(labels, len(motions), len(labels) // len(along))
    columns = {
        "share": ((), share),
        "share_error": ((), error),
        **columns_of(machines, motions),
    }
    variables: dict[str, tuple[tuple[str, ...], np.ndarray]] = {"is_found": ((path, ATTRACTOR), is_found)}
    for key, (own, a) in columns.items():
        whole = np.full((*shape, *a.shape[1:]), 0 if "share" in key else _FILL.get(key, np.nan), a.dtype)
        whole[value, name] = a
        variables[key] = ((path, ATTRACTOR, *own), whole)
    not_known = {
        "num_not_settled": (labels < 0) & ~ends.is_failed,
        "num_failed": ends.is_failed,
    }
    for key, which in not_known.items():
        variables[key] = ((path,), np.bincount(ends.machine[which], minlength=len(along)))
    first, last = is_found.argmax(axis=0), len(along) - 1 - is_found[::-1].argmax(axis=0)
    after = np.minimum(last + 1, len(along) - 1)
    ending = {(value[k], name[k]): name[j] for k, j in goes_to.items() if j >= 0}
    successor = [ending.get((v, k), -1) if v < len(along) - 1 else -1 for k, v in enumerate(last)]
    variables |= {
        "birth": ((ATTRACTOR,), np.where(first > 0, along[first], np.nan)),
        "death": ((ATTRACTOR,), np.where(last < len(along) - 1, along[after], np.nan)),
        "successor": ((ATTRACTOR,), np.array(successor, int)),
    }
    return _with_words(xr.Dataset(variables))


def attributes_of(ds: xr.Dataset) -> dict:
    """Attributes of a sweep, except those of its points."""
    return {name: a for name, a in ds.attrs.items() if name not in _OF_POINTS}


def _with_words(ds: xr.Dataset) -> xr.Dataset:
    ds = labelled(ds)
    ds["motion"].attrs |= flags(MOTIONS)
    ds["num_impacts"].attrs["long_name"] = "number of impacts in one cycle"
    ds["held_time"].attrs["long_name"] = "for how long the stop holds its mass in one cycle"
    return ds
