"""Machines with a mass between two stops and coexisting attractors, found once for each machine."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import xarray as xr

import vijax as vx

# Error of quantities computed from polished cycles, which close to 1e-13.
EXACT = 1e-9


@dataclass(frozen=True)
class Of:
    """A machine that a cache compares by its text."""

    system: vx.ImpactSystem = field(compare=False)
    text: str = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "text", repr(self.system))


def machine(frequency: float, amplitude: float = 1.0, restitution: float = 0.8) -> vx.ImpactSystem:
    """A mass on a spring between two equal stops."""
    stops = [vx.Stop(0, -0.5, "lower", restitution), vx.Stop(0, 0.5, "upper", restitution)]
    return vx.ImpactSystem([1.0], [[0.05]], [[1.0]], vx.Harmonic([amplitude], frequency), stops)


# Two motions, each the mirror image of the other; a cycle of three periods beside one of one; a motion without
# impacts beside one with impacts; two chaotic ones.
MIRRORED, THREE, QUIET, CHAOTIC = machine(1.5), machine(4.0, 4.0, 0.9), machine(3.0), machine(1.25)


@cache
def _found(of: Of, starts: int, seed: int) -> xr.Dataset:
    return vx.attractors(of.system, starts, seed=seed, progress=False)


def found(system: vx.ImpactSystem, starts: int = 60, seed: int = 0) -> xr.Dataset:
    """Attractors from random starts, computed once for each machine."""
    return _found(Of(system), starts, seed)


def states(ds: xr.Dataset) -> np.ndarray:
    return np.concatenate([ds.x0, ds.v0], axis=-1)


def section(ds: xr.Dataset, number: int) -> np.ndarray:
    """Section points of an attractor, (points, 2 n)."""
    rows = np.concatenate([ds.section_x[number], ds.section_v[number]], axis=1)
    return rows[~np.isnan(rows[:, 0])]


def box(count: int) -> np.ndarray:
    """Random starts that fill the region between the stops."""
    return np.random.default_rng(1).uniform([-0.5, -3.0], [0.5, 3.0], (count, 2))
