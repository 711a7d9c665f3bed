"""Direct calls of the library still work when JAX raises at NaN or infinity, although logs are padded."""

import jax
import numpy as np
import pytest

import vijax as vx

MACHINE = vx.models.wagg_bishop_b(0.2)
START = [0.1, 0.0], [0.0, 0.1]


@pytest.fixture
def checks():
    """JAX's checks for all threads, as users set them: a sweep runs in threads of its own."""
    names = ("jax_debug_nans", "jax_debug_infs")
    for name in names:
        jax.config.update(name, True)
    yield
    for name in names:
        jax.config.update(name, False)


def run_all() -> list[np.ndarray]:
    """Results of all functions of a machine, as arrays."""
    sol = vx.simulate(MACHINE, 0.0, 20.0, *START, max_events=128)
    times = np.linspace(0.0, 20.0, 7)
    ds = vx.sweep(MACHINE, {"x0[0]": [0.0, 0.1]}, transient=1, record=2, progress=False)
    slope = jax.jacfwd(lambda x: vx.simulate(MACHINE, 0.0, 20.0, x, max_events=128).x1)
    found = [
        sol,
        sol.evaluate(times),
        sol.contact_force(times),
        sol.to_xarray().event_time.values,
        ds.impact_time.values,
        vx.stroboscopic_map(MACHINE, *START),
        vx.monodromy_matrix(MACHINE, *START),
        vx.monodromy_matrix(MACHINE, *START, max_steps=1, throw=False),
        vx.next_impact(MACHINE, 0.0, *START, stop=0, throw=False),
        vx.next_impact(MACHINE, 0.0, *START, stop=0, t1=1e-9, throw=False),
        slope(np.array(START[0])),
    ]
    return list(map(np.asarray, jax.tree.leaves(found)))


@pytest.mark.slow
def test_nothing_stops_and_nothing_else_is_found(request, caplog):
    expected = run_all()
    request.getfixturevalue("checks")
    with jax.log_compiles():
        found = run_all()
    assert any(np.isnan(a).any() for a in expected if a.dtype.kind == "f")
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    compiled = [record.getMessage() for record in caplog.records if "Compiling" in record.getMessage()]
    assert [message for message in compiled if "_run" in message or "run_lanes" in message] == []


def test_other_programs_are_still_checked(checks):
    vx.simulate(MACHINE, 0.0, 20.0, max_events=128)
    with pytest.raises(FloatingPointError):
        jax.numpy.log(-1.0)


@pytest.mark.slow
def test_in_a_jit_of_the_user_a_log_is_found_but_an_end_state_is_not(checks):
    def run(x):
        return vx.simulate(MACHINE, 0.0, 20.0, x, max_events=128)

    assert jax.jit(lambda x: run(x).x1)(START[0]).shape == (2,)
    with pytest.raises(FloatingPointError):
        jax.jit(lambda x: run(x).events)(START[0])
