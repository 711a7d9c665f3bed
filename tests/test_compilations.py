"""What is compiled once serves whatever else is asked of the same kind of machine."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import numpy as np
import pytest

import vijax as vx

FINISHED = "/jax/core/compile/backend_compile_duration"


@contextmanager
def counted() -> Iterator[list[str]]:
    """The compilations until the end, as they come."""
    found: list[str] = []

    def note(event: str, seconds: float, **details) -> None:
        del seconds
        if event == FINISHED:
            found.append(str(details.get("fun_name", event)))

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        yield found
    finally:
        jax.monitoring.unregister_event_duration_listener(note)


def sweep(values: dict[str, np.ndarray], **options) -> None:
    asked = {"transient": 2, "record": 3} | options
    vx.sweep(vx.models.wagg_bishop_b(0.9), values, progress=False, **asked)  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="module")
def compiled() -> None:
    """A first sweep of each of the two kinds: nothing but the frequency varies, or something else."""
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


def test_what_is_compiled_is_counted():
    with counted() as compilations:
        jax.jit(lambda x: x + 0.12345)(1.0)
    assert compilations
