"""Programs are reused for all calls with the same kind of machine."""

import jax
import numpy as np
import pytest
from helpers import counted

import vijax as vx


def sweep(values: dict[str, np.ndarray], **options) -> None:
    asked = {"transient": 2, "record": 3} | options
    vx.sweep(vx.models.wagg_bishop_b(0.9), values, progress=False, **asked)  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="module")
def compiled() -> None:
    """First sweeps of both kinds: over the frequency alone, and over another parameter."""
    sweep({"forcing.frequency": np.linspace(0.8, 1.0, 3)})
    sweep({"stops[0].position": np.linspace(-0.3, -0.2, 3)})


@pytest.mark.parametrize(
    "values",
    [
        {"forcing.frequency": np.linspace(0.8, 1.0, 17)},
        {"x0[0]": np.linspace(0.0, 0.05, 9)},
        {"forcing.amplitude[1]": np.linspace(0.1, 0.2, 5)},
        {"stops[1].restitution": np.linspace(0.5, 0.7, 33), "forcing.frequency": np.array([0.8, 1.0])},
    ],
    ids=lambda values: " ".join(values),
)
def test_another_path_and_another_number_of_points_compile_nothing(values, compiled):
    with counted() as compilations:
        sweep(values)
    assert compilations == []


@pytest.mark.parametrize(
    "option", [{"transient": 5}, {"record": 7}, {"max_impacts": 300}, {"max_steps": 900_000}], ids=str
)
def test_other_counts_compile_nothing(option, compiled):
    with counted() as compilations:
        sweep({"forcing.frequency": np.linspace(0.8, 1.0, 4)}, **option)
    assert compilations == []


def chain(stops: list[vx.Stop], amplitude: np.ndarray | None = None, masses: int = 2) -> vx.ImpactSystem:
    load = vx.Harmonic(np.full(masses, 0.3) if amplitude is None else amplitude, 0.8)
    return vx.chain(np.ones(masses), np.full(masses, 0.1), np.ones(masses), load, stops)


BOTH = [vx.Stop(0, 0.3, "upper", 0.7), vx.Stop(1, -0.4, "lower", 0.8)]


@pytest.fixture(scope="module")
def followed() -> vx.Solution:
    """A first trajectory, evaluated."""
    sol = vx.simulate(chain(BOTH), 0.0, 20.0)
    sol.evaluate(1.0)
    sol.contact_force(1.0)
    return sol


@pytest.mark.parametrize(
    "options",
    [
        {"ts": np.linspace(5.0, 30.0, 5)},
        {"ts": np.linspace(5.0, 30.0, 1000)},
        {"max_events": 40},
        {"max_events": 5000},
        {"max_steps": 12_345},
        {"throw": False},
        {"x0": [0.1, 0.0], "v0": [0.0, 1.0]},
    ],
    ids=lambda options: " ".join(options),
)
def test_another_trajectory_of_the_machine_compiles_nothing(options, followed):
    with counted() as compilations:
        vx.simulate(chain(BOTH), 5.0, 35.0, **options)  # pyright: ignore[reportArgumentType]
    assert compilations == []


@pytest.mark.parametrize(
    "stops",
    [
        [vx.Stop(1, 0.3, "upper", 0.7), vx.Stop(0, -0.4, "lower", 0.8)],
        [vx.Stop(1, -0.3, "lower", 0.7), vx.Stop(1, 0.4, "upper", 0.8)],
        [vx.Stop(0, -0.3, "lower", 0.7), vx.Stop(1, -0.4, "lower", 0.8)],
    ],
)
def test_stops_on_other_masses_and_sides_compile_nothing(stops, followed):
    with counted() as compilations:
        vx.simulate(chain(stops), 0.0, 20.0).evaluate(2.0)
    assert compilations == []


def test_another_number_of_times_compiles_nothing(followed):
    with counted() as compilations:
        for size in (0, 1, 7, 1001):
            followed.evaluate(np.linspace(0.0, 20.0, size))
            followed.contact_force(np.linspace(0.0, 20.0, size))
        followed.evaluate(np.zeros((3, 2)))
    assert compilations == []


@pytest.mark.slow
def test_harmonics_up_to_the_next_power_of_two_compile_nothing():
    vx.simulate(chain(BOTH, np.full((4, 2), 0.1)), 0.0, 20.0)
    with counted() as compilations:
        vx.simulate(chain(BOTH, np.full((3, 2), 0.1)), 0.0, 20.0)
    assert compilations == []


def test_what_is_compiled_is_counted():
    with counted() as compilations:
        jax.jit(lambda x: x + 0.12345)(1.0)
    assert compilations
