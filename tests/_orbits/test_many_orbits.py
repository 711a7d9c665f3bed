"""Properties of the orbits of thousands of random machines, stable and unstable."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr
from helpers import KINDS, Event, log_of, paired

import vijax as vx

pytestmark = pytest.mark.thorough

RECORD = 12
# Event capacities: for most cycles, the number that batches are compiled for first; and for all cycles.
FEW, MANY = 32, 512
# Relative error of a product of multipliers; and of the smallest of them, relative to the largest.
PRODUCT, ROUNDING = 1e-10, 1e-13
# Closing error of an orbit relative to its size, where the largest multiplier is one or less.
CLOSING = 1e-13
# The same for a motion simulated for some periods: the last bounces of a chatter are summed.
CLOSED = 1e-10
# Error of event times simulated from the start of an orbit, relative to the period, for each unit of growth.
SAME_TIME = 1e-9


class Family(NamedTuple):
    """Machines of one shape: one of them, and the values of a grid of them."""

    system: vx.ImpactSystem
    values: dict[str, np.ndarray]


def chain_matrix(links: np.ndarray) -> np.ndarray:
    """Matrix of links in a row from the wall."""
    return np.diag(links + np.append(links[1:], 0)) - np.diag(links[1:], 1) - np.diag(links[1:], -1)


def matrices(rng: np.random.Generator, count: int, n: int, low: float, high: float) -> np.ndarray:
    """Chains with links of any size between two powers of ten."""
    return np.array([chain_matrix(10 ** rng.uniform(low, high, n)) for _ in range(count)])


def between_two_stops(rng: np.random.Generator) -> Family:
    """One mass; springs soft and stiff; stops from plastic to elastic.

    Heavy damping under a load that presses for long would make it bounce exponentially often on an elastic stop.
    """
    load = vx.Harmonic([[0.8], [0.3]], 1.0, phase=[[0.0], [1.0]])
    stops = [vx.Stop(0, 0.3, "upper", 0.7), vx.Stop(0, -0.4, "lower", 0.7)]
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, stops)
    values = {
        "forcing.frequency": 10 ** rng.uniform(-0.4, 0.6, 16),
        "damping": matrices(rng, 3, 1, -2, -0.3),
        "stiffness": np.array([0.01, 1.0, 30.0]).reshape(3, 1, 1),
        "stops[*].restitution": np.array([0.0, 0.25, 0.6, 0.9, 1.0]),
        "stops[0].position": np.array([0.05, 0.3]),
    }
    return Family(system, values)


def with_a_shaken_slot(rng: np.random.Generator) -> Family:
    """Two masses, one of them between two stops that move."""
    motion = vx.Harmonic([[0.1], [0.04]], 1.0, phase=[[0.2], [1.0]], mean=[0.02])
    stops = [
        vx.Stop(0, 0.4, "upper", 0.7),
        vx.Stop(1, 0.25, "upper", 0.6, motion),
        vx.Stop(1, -0.35, "lower", 0.8, motion),
    ]
    system = vx.chain([1.0, 0.8], [0.1, 0.05], [1.0, 1.5], vx.Harmonic([0.5, 0.0], 1.0), stops)
    values = {
        "forcing.frequency": 10 ** rng.uniform(-0.5, 0.5, 8),
        "damping": matrices(rng, 4, 2, -2, 0),
        "stiffness": matrices(rng, 4, 2, -0.5, 1),
        "stops[*].restitution": np.array([0.0, 0.1, 0.5, 0.85]),
        "forcing.amplitude[0]": np.array([0.5, 1.5]),
    }
    return Family(system, values)


def three_masses(rng: np.random.Generator) -> Family:
    """Damping that the modes diagonalise."""
    mass = np.array([0.7, 1.6, 1.0])
    stops = [vx.Stop(0, 0.2, "upper", 0.7), vx.Stop(2, -0.3, "lower", 0.7), vx.Stop(1, 0.3, "upper", 0.7)]
    system = vx.ImpactSystem(mass, np.diag(0.15 * mass), np.eye(3), vx.Harmonic([0.8, -0.5, 0.3], 1.0), stops)
    values = {
        "forcing.frequency": 10 ** rng.uniform(-0.5, 0.5, 8),
        "stiffness": matrices(rng, 6, 3, -0.5, 1),
        "stops[*].restitution": np.array([0.0, 0.4, 0.8]),
        "stops[0].position": rng.uniform(0.02, 0.5, 3),
    }
    return Family(system, values)


def four_masses(rng: np.random.Generator) -> Family:
    """Four stops, two of them at the last mass.

    None is plastic: several plastic impacts give as many zero multipliers, which rounding changes to roots of itself.
    """
    mass = np.array([1.2, 0.8, 1.0, 0.6])
    stops = [
        vx.Stop(3, 0.3, "upper", 0.7),
        vx.Stop(3, -0.3, "lower", 0.7),
        vx.Stop(0, 0.2, "upper", 0.7),
        vx.Stop(1, 0.4, "upper", 0.7),
    ]
    load = vx.Harmonic([0.6, -0.3, 0.5, 0.4], 1.0)
    system = vx.ImpactSystem(mass, np.diag(0.2 * mass), np.eye(4), load, stops)
    values = {
        "forcing.frequency": 10 ** rng.uniform(-0.4, 0.5, 8),
        "stiffness": matrices(rng, 6, 4, -0.5, 1),
        "stops[*].restitution": np.array([0.2, 0.4, 0.75]),
        "stops[0].position": rng.uniform(0.02, 0.5, 4),
    }
    return Family(system, values)


FAMILIES: list[Callable[[np.random.Generator], Family]] = [
    between_two_stops,
    with_a_shaken_slot,
    three_masses,
    four_masses,
]
# Larger machines, and those with a long chatter, take long to compile.
CHOSEN = [
    pytest.param((between_two_stops, FEW), id="between_two_stops", marks=pytest.mark.slow),
    pytest.param((with_a_shaken_slot, FEW), id="with_a_shaken_slot", marks=pytest.mark.slow),
    *(pytest.param((f, MANY), id=f"{f.__name__}_of_all_chatters", marks=pytest.mark.slow) for f in FAMILIES),
]


class Found(NamedTuple):
    """A family, its settled motions, and their orbits; points are the first axis."""

    family: Family
    room: int
    swept: xr.Dataset
    kinds: xr.Dataset
    orbits: xr.Dataset

    @property
    def is_chattering(self) -> xr.DataArray:
        return np.isinf(self.kinds.num_impacts).any("stop")

    @property
    def size(self) -> xr.DataArray:
        """Size of each motion: its fastest impact, or its state at the end of a period."""
        rate = 2 * np.pi / self.swept.forcing_period
        states = np.maximum(abs(self.swept.v), abs(self.swept.x) * rate).max("mass")
        return np.maximum(abs(self.swept.impact_velocity).max("impact").fillna(0), states)

    @property
    def volume(self) -> xr.DataArray:
        """Factor by which a cycle contracts a volume of states: exp(-tr(M^-1 C) n T) times r^2 for each impact."""
        damping = np.asarray(self.family.system.damping)[None]
        which = np.zeros(self.orbits.sizes["point"], int)
        if "damping" in self.family.values:
            damping, which = self.family.values["damping"], self.orbits["damping"].values.astype(int)
        decay = np.einsum("kii,i->k", damping, 1 / np.asarray(self.family.system.mass))[which]
        flown = np.exp(-decay * self.orbits.num_periods * self.swept.forcing_period)
        return flown * self.orbits["stops[*].restitution"] ** (2 * self.orbits.num_impacts.sum("stop"))

    @property
    def rounding(self) -> xr.DataArray:
        """Least error of a product of multipliers: the smallest is only as exact as the largest."""
        return ROUNDING * abs(self.orbits.multipliers[:, :-1]).prod("multiplier")


@pytest.fixture(scope="module", params=CHOSEN)
def found(request) -> Found:
    return found_in(*request.param)


@cache
def found_in(make: Callable[[np.random.Generator], Family], room: int) -> Found:
    family = make(np.random.default_rng(7))
    swept = vx.sweep(family.system, family.values, transient=150, record=RECORD, progress=False)
    kinds, orbits = vx.classify(swept), vx.periodic_orbits(swept, max_events=room, progress=False)
    return Found(family, room, *map(in_a_row, (swept, kinds, orbits)))


def in_a_row(ds: xr.Dataset) -> xr.Dataset:
    dims = [dim for dim in ds.dims if dim in ds.coords and ds[dim].dims == (dim,)]
    return ds.stack(point=dims).transpose("point", ...)


@pytest.mark.slow
def test_every_periodic_motion_becomes_an_orbit(found):
    orbits, kinds = found.orbits, found.kinds
    is_periodic = kinds.num_periods > 0
    assert float(is_periodic.mean()) > 0.6
    # Impacts, and a release for every stick.
    num_events = (found.swept.num_impacts + 2 * found.swept.num_sticks).sum("stop") / RECORD
    is_short = num_events * kinds.num_periods < found.room
    assert float(is_short.mean()) > 0.9
    np.testing.assert_array_equal(orbits.converged[is_short.values], is_periodic[is_short.values])
    assert not (orbits.converged & ~is_periodic).any()
    is_known = (orbits.converged & ~found.is_chattering).values
    for name in ("num_periods", "num_impacts"):
        np.testing.assert_array_equal(orbits[name][is_known], kinds[name][is_known])
    assert bool(orbits.is_stable[orbits.converged.values].all())


@pytest.mark.slow
def test_they_close_to_rounding(found):
    assert float(found.orbits.residual.max()) < CLOSING


def test_their_multipliers_multiply_to_the_loss_of_volume(found):
    orbits = found.orbits
    is_free = (orbits.converged & (abs(orbits.multipliers) > 0).all("multiplier")).values
    assert is_free.sum() > 100
    error = abs(orbits.multipliers.prod("multiplier") - found.volume)
    assert bool((error <= PRODUCT * found.volume + found.rounding)[is_free].all())


def test_two_multipliers_are_zero_for_a_mass_that_sticks(found):
    orbits = found.orbits
    num_zeros = (orbits.multipliers == 0).sum("multiplier").values
    # A plastic impact makes one multiplier zero, up to rounding.
    is_bouncing = orbits.converged & (orbits["stops[*].restitution"] > 0)
    is_held = (found.kinds.held_time > 0).any("stop")
    assert int((is_bouncing & is_held).sum()) > 30
    assert set(num_zeros[is_bouncing & is_held].tolist()) <= {2, 4, 6, 8}
    # After many impacts the smallest multiplier may be below the rounding of the largest.
    is_free = is_bouncing & ~is_held & (found.volume > found.rounding)
    assert int(is_free.sum()) > 100
    assert not num_zeros[is_free].any()
    assert num_zeros[orbits.converged & is_held].min() >= 2


def test_the_machines_go_round_them(found):
    family, orbits, swept = found.family, found.orbits, found.swept
    start = {name: swept[name].where(~orbits.converged, orbits[f"{name}0"]).variable for name in ("x", "v")}
    start = swept.assign(start).unstack("point")
    again = vx.sweep(
        family.system, family.values, transient=0, record=RECORD, carry_from=start, progress=False
    )
    again = in_a_row(again)
    scale = {"x": 2 * np.pi / swept.forcing_period, "v": xr.ones_like(swept.forcing_period)}
    for n in np.unique(orbits.num_periods[orbits.converged.values]):
        which = np.flatnonzero(orbits.converged & (orbits.num_periods == n))
        ends = again.isel(point=which, period=slice(n - 1, None, n))
        for name in ("x", "v"):
            change = abs(ends[f"section_{name}"] - orbits[f"{name}0"][which]) * scale[name][which]
            assert float((change / found.size[which]).max()) < CLOSED
        counted = which[~found.is_chattering.values[which]]
        if RECORD % n == 0:
            counts = again.num_impacts[counted] * n // RECORD
            np.testing.assert_array_equal(counts, orbits.num_impacts[counted])


@pytest.mark.slow
def test_their_events_are_those_of_a_run(found):
    for k in np.flatnonzero(found.orbits.converged)[:: found.orbits.sizes["point"] // 12]:
        point, one = found.swept.isel(point=int(k)), found.orbits.isel(point=int(k))
        n, start = int(one.num_periods), (one.x0.values, one.v0.values)
        orbit = vx.periodic_orbit(vx.system_of(point), *start, n, max_events=found.room)
        assert_happens_alike(orbit)
        np.testing.assert_allclose(orbit.x0, one.x0, rtol=0, atol=CLOSING * float(found.size[k]))


def assert_happens_alike(orbit: vx.PeriodicOrbit) -> None:
    """Check that the log of an orbit is that of a run from its start."""
    growth, log = max(1.0, float(abs(orbit.multipliers[0]))), orbit.events
    columns = zip(*(a.tolist() for a in (log.t, log.kind, log.stop, log.velocity_minus)), strict=True)
    ours = [Event(t, KINDS[kind], stop, v) for t, kind, stop, v in columns if kind >= 0]
    for one, other in paired(ours, log_of(orbit.solution())):
        assert abs(one.t - other.t) < SAME_TIME * growth * float(orbit.period)


@pytest.mark.slow
def test_orbits_of_one_mass_stable_and_unstable():
    rng, is_stable = np.random.default_rng(3), []
    for _ in range(24):
        frequency, n = rng.uniform(1.5, 4), int(rng.integers(1, 5))
        damping, place, r = rng.uniform(0, 0.05), rng.uniform(-0.1, 0.3), rng.uniform(0.5, 0.9)
        stops = [vx.Stop(0, place, "upper", r)]
        system = vx.ImpactSystem([1.0], [[damping]], [[1.0]], vx.Harmonic([1.0], frequency), stops)
        starts = place - 2 * rng.uniform(0, 1, (64, 1)), frequency * rng.normal(size=(64, 1))
        for orbit in vx.find_periodic_orbits(system, starts, n, max_events=FEW, progress=False):
            assert_happens_alike(orbit)
            first, second = np.abs(orbit.multipliers)
            assert float(orbit.residual) < CLOSING * max(1.0, first)
            expected = np.exp(-damping * float(orbit.period)) * r ** (2 * int(orbit.num_impacts[0]))
            product = np.prod(orbit.multipliers).real if second > 0 else expected
            assert abs(product - expected) < PRODUCT * expected + ROUNDING * first * max(1.0, first)
            is_stable.append(bool(orbit.is_stable))
    assert is_stable.count(True) > 15
    assert is_stable.count(False) > 15
