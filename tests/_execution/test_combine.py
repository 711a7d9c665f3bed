"""Parts of a sweep are joined into the whole sweep, bit for bit."""

import re
from functools import partial

import pytest
import xarray as xr
from test_store import FREQUENCIES, FREQUENCY, assert_same, sweep as run_sweep

import vijax as vx

# Short; the first frequencies chatter, and have many more impacts than the others.
sweep = partial(run_sweep, transient=1, record=2)


def plane(frequencies: slice, starts: list[float], **options) -> xr.Dataset:
    return sweep(values={FREQUENCY: FREQUENCIES[frequencies], "x0[0]": starts}, **options)


@pytest.fixture(scope="module")
def parts() -> list[xr.Dataset]:
    """Four parts of a plane, two by two."""
    return [plane(f, x) for f in (slice(0, 5), slice(5, 24)) for x in ([0.0, -0.1], [-0.2])]


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    return plane(slice(0, 24), [0.0, -0.1, -0.2])


def test_parts_of_a_plane_make_the_plane(parts, whole):
    assert parts[0].sizes["impact"] > 2 * parts[2].sizes["impact"]
    assert_same(vx.combine([parts[k] for k in (2, 0, 3, 1)]), whole)


def test_parts_that_are_read_lazily_are_joined_lazily(parts, whole):
    pytest.importorskip("dask")
    joined = vx.combine([part.chunk() for part in parts])
    assert all(a.chunks is not None for a in joined.data_vars.values())
    xr.testing.assert_identical(joined.load().drop_attrs(), whole.drop_attrs())


def test_the_steps_of_lanes_are_those_of_all_parts():
    parts = [plane(f, [0.0]) for f in (slice(0, 5), slice(5, 24))]
    steps = [part.steps.attrs["lane_steps"] for part in parts]
    assert vx.combine(parts).steps.attrs["lane_steps"] == sum(steps)


OTHERS = {
    "a gap": (lambda parts: parts[:3], "must tile a grid without a gap"),
    "a value twice": (
        lambda parts: [parts[0], plane(slice(4, 8), [0.0, -0.1])],
        "Values of `forcing.frequency`",
    ),
    "a part twice": (lambda parts: [parts[0], parts[0]], "must tile a grid without a gap"),
    "another machine": (
        lambda parts: [parts[0], plane(slice(5, 9), [0.0, -0.1], system=vx.models.wagg_bishop_b(1.0, 0.4))],
        "number 1 differs from number 0: `system.forcing.amplitude[0]` is 0.5 there, but 0.4 here",
    ),
    "another record": (
        lambda parts: [parts[0], plane(slice(5, 9), [0.0, -0.1], record=1)],
        "`record` is 2 there, but 1 here",
    ),
    "other variables": (lambda parts: [parts[0], parts[2].drop_vars("v")], "but missing here"),
    "nothing": (lambda parts: [], "a list of one dataset or more"),
    "no sweep": (lambda parts: [parts[0], parts[2].drop_attrs()], "number 1 has no `system`"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_what_does_not_fit_together_is_refused(parts, what):
    made, sentence = OTHERS[what]
    with pytest.raises(ValueError, match=re.escape(sentence)):
        vx.combine(made(parts))
