"""The log of events as a table: a row an event, kinds as words."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

COLUMNS = ["t", "stop", "kind", "velocity_minus", "velocity_plus", "impulse"]
WORDS = {
    vx.IMPACT: "impact",
    vx.STICK: "stick",
    vx.RELEASE: "release",
    vx.CLOSE: "close",
    vx.OPEN: "open",
    vx.SLIP: "slip",
    vx.TURN: "turn",
}
# A thousand events, so that nearly all of the log is padding.
ROOM = 1000
LOAD = vx.Harmonic([1.0], 1.0)


def oscillator(damping: float, stops: list, **parts) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[damping]], [[1.0]], LOAD, stops, **parts)


def run(system: vx.ImpactSystem) -> vx.Solution:
    return vx.simulate(system, 0.0, 40.0, max_events=ROOM)


MACHINES = {
    "chatter, sticks and releases": (
        vx.models.wagg_bishop_b(0.2),
        {"impact", "stick", "release"},
    ),
    "a compliant stop": (
        oscillator(0.1, [vx.CompliantStop(0, 0.3, "upper", 20.0)]),
        {"close", "open"},
    ),
    "friction": (
        oscillator(0.0, [], friction=[vx.Friction(0, 0.6, velocity=0.3)]),
        {"stick", "slip"},
    ),
}


@pytest.mark.parametrize("name", MACHINES)
def test_every_event_has_one_row_with_the_numbers_of_the_log(name):
    system, kinds = MACHINES[name]
    sol = run(system)
    table, count = sol.events.to_dataframe(), int(sol.num_events)
    assert list(table.columns) == COLUMNS
    assert len(table) == count
    assert 0 < count < ROOM
    assert kinds <= set(table.kind)
    for column in COLUMNS:
        expected = np.asarray(getattr(sol.events, column))[:count]
        if column == "kind":
            expected = [WORDS[int(kind)] for kind in expected]
        np.testing.assert_array_equal(table[column], expected)


def test_a_motion_without_events_has_an_empty_table():
    system = oscillator(0.1, [vx.Stop(0, 50.0, "upper", 0.5)])
    table = run(system).events.to_dataframe()
    assert len(table) == 0
    assert list(table.columns) == COLUMNS


@pytest.mark.slow
def test_a_batch_of_logs_is_refused():
    system = vx.models.wagg_bishop_a(0.8)
    sol = jax.vmap(lambda x: vx.simulate(system, 0.0, 10.0, x0=jnp.zeros(2).at[0].set(x)))(jnp.zeros(2))
    with pytest.raises(ValueError, match="batch of shape"):
        sol.events.to_dataframe()
    first = jax.tree.map(lambda a: a[0], sol.events).to_dataframe()
    assert len(first) == int(sol.num_events[0])


def test_traced_logs_are_refused():
    with pytest.raises(ValueError, match=r"outside of `jax\.jit`"):
        jax.jit(lambda x: vx.simulate(vx.models.wagg_bishop_a(0.8), 0.0, 5.0, x0=x).events.to_dataframe())(
            jnp.zeros(2)
        )
