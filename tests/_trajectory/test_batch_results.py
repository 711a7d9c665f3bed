"""A batch of trajectories is evaluated, labelled, stored and printed like its lanes one by one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from outputs import FILES, assert_comes_back, names_of, show

import vijax as vx

pytestmark = pytest.mark.thorough

END = 25.0
FREQUENCIES, STARTS = np.array([0.3, 0.3, 1.1, 1.4]), np.array([0.0, 0.05, -0.05, 0.2])
# The last lane starts beyond a stop.
SOUND = range(3)


@pytest.fixture(scope="module")
def machines_and_batch() -> tuple[vx.ImpactSystem, vx.Solution]:
    """Lanes with save times of their own."""

    def run(frequency, x):
        system = vx.models.wagg_bishop_b(frequency)
        ts = jnp.linspace(0.0, END, 4) * frequency / 1.4
        return system, vx.simulate(system, 0.0, END, [0.0, x], ts=ts, max_events=64, throw=False)

    return jax.jit(jax.vmap(run))(jnp.asarray(FREQUENCIES), jnp.asarray(STARTS))


@pytest.fixture(scope="module")
def batch(machines_and_batch) -> vx.Solution:
    return machines_and_batch[1]


def lane(batch: vx.Solution, k: int) -> vx.Solution:
    return jax.tree.map(lambda a: a[k], batch)


@pytest.mark.slow
def test_a_batch_is_evaluated_lane_by_lane(batch):
    t = np.linspace(0.0, END, 6).reshape(2, 3)
    x, v = batch.evaluate(t)
    force, (at, speed) = batch.contact_force(t), batch.evaluate_stops(t)
    assert x.shape == v.shape == (4, 2, 3, 2)
    assert force.shape == at.shape == speed.shape == (4, 2, 3, 2)
    assert (np.asarray(force)[SOUND] > 0).any()
    for k in SOUND:
        one = vx.simulate(vx.models.wagg_bishop_b(FREQUENCIES[k]), 0.0, END, [0.0, STARTS[k]])
        np.testing.assert_allclose(x[k], one.evaluate(t)[0], rtol=0, atol=1e-13)
        np.testing.assert_allclose(force[k], one.contact_force(t), rtol=0, atol=1e-12)
        np.testing.assert_allclose(at[k], one.evaluate_stops(t)[0])


@pytest.mark.parametrize("way", FILES)
def test_a_batch_comes_back_from_a_file_as_it_was(tmp_path, way, batch):
    assert_comes_back(batch.to_xarray(), way, tmp_path / "file")


def test_a_batch_has_lanes_in_front(batch):
    ds = batch.to_xarray()
    longest = int(batch.num_events.max())
    assert dict(ds.sizes) == {"lane": 4, "time": 4, "mass": 2, "event": longest, "stop": 2}
    assert ds.time.dims == ("lane", "time")
    assert names_of(ds.result) == [*["successful"] * 3, "unsound_start"]
    for k in SOUND:
        one, ours = lane(batch, k).to_xarray(), ds.isel(lane=k)
        count = one.sizes["event"]
        assert (ours.event_stop[count:] == -1).all()
        assert (ours.event_kind[count:] == -1).all()
        assert np.isnan(ours.event_time[count:]).all()
        xr.testing.assert_equal(ours.isel(event=slice(count)).drop_vars("time"), one.drop_vars("time"))
        np.testing.assert_array_equal(ours.time, one.time)


def test_lanes_that_share_their_times_share_one_axis(batch):
    shared = eqx.tree_at(lambda s: s.ts, batch, jnp.broadcast_to(batch.ts[0], batch.ts.shape))
    ds = shared.to_xarray()
    assert ds.time.dims == ("time",)
    np.testing.assert_array_equal(ds.sel(time=batch.ts[0, 1], method="nearest").x, batch.xs[:, 1])


def test_a_batch_of_batches_is_not_labelled(batch):
    with pytest.raises(ValueError, match="one trajectory or one batch"):
        jax.tree.map(lambda a: a[None], batch).to_xarray()


def test_a_batch_says_its_shape_and_ranges(machines_and_batch):
    systems, solutions = machines_and_batch
    for thing in (systems, systems.forcing, solutions, solutions.events):
        assert "a batch of shape (4,)" in show(thing)
    assert "frequency 0.3 to 1.4" in show(systems)
    assert "3 successful, 1 unsound_start" in show(solutions)
    assert "batch" in show(jax.tree.map(lambda a: a[None], solutions))
