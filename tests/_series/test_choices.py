"""Branches of forces: their guards, modes and knots."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from force_series import bound, first_modes, motion

from vijax._series.modes import bounds_of_mode, decide, next_knot, num_rounds
from vijax._series.plan import plan_force
from vijax._series.series import force_at, series_of

KNOTS, VALUES = np.array([-0.4, -0.1, 0.1, 0.4]), np.array([-1.5, -0.1, 0.1, 1.5])
CHOICES = {
    "abs": lambda t, x, v, a: x * jnp.abs(x),
    "sign": lambda t, x, v, a: jnp.sign(v) + x,
    "max and min": lambda t, x, v, a: jnp.maximum(x - 0.25, 0.0) + jnp.minimum(x + 0.25, 0.0),
    "max of all": lambda t, x, v, a: jnp.max(x) * jnp.ones(2) + jnp.argmin(x),
    "clip": lambda t, x, v, a: jnp.clip(x, -0.2, 0.3),
    "where": lambda t, x, v, a: jnp.where((x > 0.1) | ~(v < 0.2), x, 4 * x),
    "select": lambda t, x, v, a: jnp.select([x > 0.3, x > 0, x > -0.3], [x, x**2, x**3], -x),
    "piecewise": lambda t, x, v, a: jnp.piecewise(x, [x < -0.1, x >= 0.2], [jnp.sin, jnp.cos, jnp.exp]),
    "cond": lambda t, x, v, a: jax.lax.cond(x[0] > x[1], jnp.sin, jnp.cos, x),
    "switch": lambda t, x, v, a: jax.lax.switch(
        (x[0] > 0).astype(int) + (v[1] > 0), [jnp.sin, jnp.cos, jnp.exp], x
    ),
    "flag": lambda t, x, v, a: (x > 0.1) * x + (v >= 0) * 2.0,
    "table": lambda t, x, v, a: jnp.interp(x, KNOTS, VALUES),
    "extrapolated": lambda t, x, v, a: jnp.interp(x, KNOTS, VALUES, left="extrapolate", right="extrapolate"),
    "choices in choices": lambda t, x, v, a: jnp.where(
        jnp.maximum(x, v) > 0.1, jnp.clip(x, -1, v), jnp.abs(v)
    ),
    "xor": lambda t, x, v, a: jnp.where(jnp.logical_xor(x > 0, v > 0), x, v),
    "roots of what is open": lambda t, x, v, a: jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1.0)), 0.0),
    "power": lambda t, x, v, a: jnp.maximum(x - 0.1, 0.0) ** 1.5 + jnp.sqrt(jnp.maximum(v, 0.0)),
    "softplus": lambda t, x, v, a: jax.nn.softplus(10 * x),
    "gradient of max": lambda t, x, v, a: jax.grad(lambda x: jnp.sum(jnp.maximum(x, 0.1) ** 2))(x),
    "gradient of the largest": lambda t, x, v, a: jax.grad(lambda x: jnp.max(x) ** 2)(x),
    "gradient of clip": lambda t, x, v, a: jax.grad(lambda x: jnp.sum(jnp.clip(x, -0.1, 0.2) ** 2))(x),
    "by numbers": lambda t, x, v, a: jnp.where(a > 1, x, v) + jnp.floor(a) * x,
}


@pytest.mark.parametrize("name", CHOICES)
def test_the_modes_choose_the_branches_of_the_force(name):
    force = bound(CHOICES[name], 2, 1.7)
    plan = plan_force(force, 2)
    for seed in range(6):
        x, v = map(jnp.asarray, np.random.default_rng(seed).uniform(-0.6, 0.6, (2, 2)))
        modes = first_modes(plan, force, jnp.float64(0), x, v)
        found = force_at(plan, force, jnp.float64(0), x, v, modes)
        np.testing.assert_allclose(found, force(jnp.float64(0), x, v), rtol=1e-15, atol=1e-16)


def switches_of(force, args=None):
    return plan_force(bound(force, 1, args), 1).switches


def test_equal_and_opposite_guards_share_a_mode():
    assert (
        len(switches_of(lambda t, x, v, a: jnp.abs(x) + jnp.where(x > 0, x, 0) + jnp.where(-2 * x < 0, v, 0)))
        == 1
    )
    assert len(switches_of(lambda t, x, v, a: jnp.maximum(x, v) + jnp.sign(v - x))) == 1


def test_choices_by_numbers_alone_have_no_mode():
    assert switches_of(lambda t, x, v, a: jnp.where(a > 0, x, -x) + jnp.maximum(a, 0) * v, 1.3) == ()


def test_guards_at_a_knot_take_the_branch_that_they_enter():
    force = bound(lambda t, x, v, a: -jnp.where(x > 0, x, 4 * x) + a, 1, -2.0)
    plan = plan_force(force, 1)
    modes = lambda x, v: float(first_modes(plan, force, jnp.float64(0), jnp.array([x]), jnp.array([v]))[0])  # noqa: E731
    assert [modes(0.0, 1.0), modes(0.0, -1.0), modes(0.0, 0.0), modes(1.0, 0.0)] == [1, 0, 0, 1]


def test_modes_that_depend_on_modes_need_as_many_rounds():
    nested = lambda t, x, v, a: jnp.where(jnp.where(jnp.abs(x) > 0.2, x, v) > 0, x, -x)  # noqa: E731
    assert num_rounds(plan_force(bound(nested), 1)) == 4
    assert num_rounds(plan_force(bound(lambda t, x, v, a: -x), 1)) == 1


def test_knots_of_time_are_known_ahead():
    force = bound(lambda t, x, v, a: jnp.where(t > a, 1.0, 0.0) + jnp.interp(t, KNOTS, VALUES) - x, 1, 30.05)
    plan = plan_force(force, 1)
    assert [w.is_time for w in plan.switches] == [True, True]
    one, table = (next(j for j, w in enumerate(plan.switches) if len(w.knots) == size) for size in (1, 4))
    modes = jnp.zeros(2).at[table].set(2)
    series = motion(plan, force, jnp.float64(0.0), jnp.zeros(1), jnp.zeros(1), 2, modes)[2]
    assert [tuple(map(float, next_knot(series, j))) for j in (one, table)] == [(30.05, 1), (0.1, 1)]
    modes = modes.at[table].set(4).at[one].set(1)
    after = motion(plan, force, jnp.float64(31.0), jnp.zeros(1), jnp.zeros(1), 3, modes)[2]
    assert [float(next_knot(after, j)[0]) for j in range(2)] == [np.inf, np.inf]
    np.testing.assert_array_equal(decide(after), modes)


def test_knots_of_a_time_that_runs_back_come_in_descending_order():
    force = bound(lambda t, x, v, a: jnp.where(2.0 - a * t > 0.5, x, 0), 1, 3.0)
    plan = plan_force(force, 1)
    series = motion(plan, force, jnp.float64(0.1), jnp.zeros(1), jnp.zeros(1), 3, jnp.array([0.0]))[2]
    time, change = next_knot(series, 0)
    np.testing.assert_allclose(time, 0.5, rtol=1e-15)
    assert decide(series)[0] + change in (0, 1)


def test_guards_of_positions_are_no_knots_of_time():
    assert not any(
        w.is_time for w in switches_of(lambda t, x, v, a: jnp.maximum(x, t) + jnp.sign(jnp.cos(t)))
    )


def test_a_mode_lies_between_two_knots():
    force = bound(lambda t, x, v, a: jnp.interp(x, KNOTS, VALUES))
    series = motion(plan_force(force, 1), force, 0.0, jnp.array([0.2]), jnp.zeros(1), 2, jnp.array([3.0]))[2]
    assert [tuple(map(float, bounds_of_mode(series, 0, jnp.float64(m)))) for m in (0, 3, 4)] == [
        (-np.inf, -0.4),
        (0.1, 0.4),
        (0.4, np.inf),
    ]


def test_tables_may_be_numbers_of_the_force():
    table = lambda t, x, v, a: jnp.interp(x, a["at"], a["value"])  # noqa: E731
    force = bound(table, 1, {"at": KNOTS, "value": VALUES})
    plan = plan_force(force, 1, jacobian=True)
    x = jnp.array([0.25])
    modes = first_modes(plan, force, jnp.float64(0), x, x)
    series = motion(plan, force, jnp.float64(0), x, x, 3, modes)[2]
    np.testing.assert_allclose(series.force(0), np.interp(x, KNOTS, VALUES), rtol=1e-15)
    np.testing.assert_allclose(series.by_x(0)[0, 0], 1.4 / 0.3, rtol=1e-15)


def test_jumps_of_tables_have_one_value_on_each_side():
    force = bound(
        lambda t, x, v, a: jnp.interp(x, np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 1.0, 5.0, 6.0]))
    )
    plan = plan_force(force, 1)
    value = lambda x, mode: float(force_at(plan, force, 0.0, jnp.array([x]), jnp.zeros(1), [mode])[0])  # noqa: E731
    assert [value(0.5, 1.0), value(1.0, 1.0), value(1.0, 3.0), value(1.5, 3.0)] == [0.5, 1.0, 5.0, 5.5]


def test_a_mode_for_every_switch_must_be_given():
    force = bound(lambda t, x, v, a: jnp.abs(x))
    with pytest.raises(ValueError, match="1 switches, but 0 modes"):
        series_of(plan_force(force, 1), force, 0.0, like=jnp.zeros(1))


@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_derivatives_of_powers_that_are_off_are_zero(derivative):
    force = bound(lambda t, x, v, a: jnp.maximum(x, 0.0) ** 1.5 + jnp.sqrt(jnp.maximum(x, 0.0)))
    plan = plan_force(force, 1)
    of = lambda x: motion(plan, force, jnp.float64(0), x, x, 4, [jnp.float64(0)])[2].force(3)  # noqa: E731
    np.testing.assert_array_equal(derivative(of)(jnp.array([-0.3])), 0)
