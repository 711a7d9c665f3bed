"""Text in `print` and notebooks: numbers in a few lines, for all objects."""

import equinox as eqx
import jax
import numpy as np
import pytest
from outputs import show

import vijax as vx
from vijax._system.force import name_of_force

MACHINE = vx.models.wagg_bishop_b(0.2)


class Spring(eqx.Module):
    cubic: float
    wall: vx.Stop

    def __call__(self, t, x, v, args):
        return -self.cubic * x**3


def long_chain(n: int) -> vx.ImpactSystem:
    load = vx.Harmonic(np.full((2, n), 1 / 3), 1.0, np.full((2, n), 0.1), np.full(n, -9.81))
    stops = [vx.Stop(i, 1.0 + i, "upper", 0.5) for i in range(n)]
    spring = Spring(2e6, stops[0])
    return vx.chain(np.ones(n), np.full(n, 0.1), np.full(n, 7.0), load, stops, spring)


@pytest.fixture(scope="module")
def solution() -> vx.Solution:
    return vx.simulate(MACHINE, 0.0, 80.0)


def test_a_machine_shows_its_numbers():
    text = show(MACHINE)
    assert text.splitlines()[0] == "ImpactSystem of 2 masses and 2 stops"
    for words in ("[0.2 -0.1] [-0.1 0.1]", "[2 -1] [-1 1]", "amplitude 0.5 0, frequency 0.2"):
        assert words in text
    assert "mass 0, x >= -0.3, restitution 0.7" in text
    assert show(MACHINE.stops[1]) == "Stop of mass 1: x <= 0.1, restitution 0.7"
    assert "frequency  0.2" in show(MACHINE.forcing)


def test_a_long_machine_is_cut_short():
    system = long_chain(20)
    text = show(system)
    assert "1 1 1 ... 1 (20 numbers)" in text
    assert "17 more stops" in text
    assert "Spring(cubic=2000000.0" in text
    assert "mean" in show(system.forcing)


def test_machines_without_stops_and_with_moving_ones_are_shown():
    oscillator = vx.ImpactSystem([1.0], [[0.0]], [[1.0]], vx.Harmonic([1.0], 1.0))
    assert "1 mass and 0 stops" in show(oscillator)
    assert show(vx.simulate(oscillator, 0.0, 1.0))
    table = vx.models.ball_on_table(60.0, 0.004)
    assert "x >= 0 + motion of amplitude 0.004" in show(table)
    assert "frequency" not in show(table.stops[0].motion)


def test_a_trajectory_says_what_became_of_it(solution):
    text = show(solution)
    impacts = int((solution.events.kind == vx.IMPACT).sum())
    for words in ("t = 0 to 80", "successful", f"{impacts} impacts, 5 sticks, 4 releases", "held by stop 0"):
        assert words in text
    assert f"{solution.x1[1]:.6g}" in text


def test_a_log_shows_its_ends(solution):
    lines = show(solution.events).splitlines()
    count = int(solution.num_events)
    assert "1024 events" in lines[0]
    assert lines[2].split()[:3] == ["0", f"{solution.events.t[0]:.6g}", "impact"]
    assert lines[5].split() == ["..."]
    assert lines[-1].split()[:3] == [str(count - 1), f"{solution.events.t[count - 1]:.6g}", "stick"]
    assert "nan" not in str(lines)


def test_a_short_log_is_shown_whole():
    log = vx.simulate(MACHINE, 0.0, 3.0).events
    assert len(show(log).splitlines()) == 2 + int((log.kind >= 0).sum())
    assert len(show(vx.simulate(MACHINE, 0.0, 0.1).events).splitlines()) == 1


def test_what_is_traced_shows_shapes():
    shown = []

    def run(frequency):
        system = vx.models.wagg_bishop_b(frequency)
        sol = vx.simulate(system, 0.0, 1.0)
        shown.extend(map(show, (system, system.forcing, system.stops[0], sol, sol.events)))
        return sol.x1

    jax.eval_shape(run, 0.2)
    assert "frequency float64[]" in shown[0]
    assert "float64[2]" in shown[3]
    assert "int64[1024]" in shown[4]


@pytest.mark.parametrize("leaf", [None, True, object(), "text", jax.ShapeDtypeStruct((), float)])
def test_a_machine_of_anything_else_than_numbers_is_shown(solution, leaf):
    for thing in (MACHINE, MACHINE.stops[0], MACHINE.forcing, solution, solution.events):
        odd = jax.tree.map(lambda _: leaf, thing)
        assert repr(odd)
        assert odd._repr_html_()


def test_a_machine_that_is_not_finished_is_shown():
    assert "ImpactSystem(" in repr(object.__new__(vx.ImpactSystem))


def test_numbers_of_single_precision_are_called_so():
    assert "float32" in show(jax.tree.map(lambda a: a.astype("float32"), MACHINE)).splitlines()[0]


def test_names_in_stores_and_attributes_do_not_depend_on_what_is_printed():
    """Otherwise old stores would be rejected, and attributes would repeat numbers that are stored elsewhere."""
    assert name_of_force(long_chain(2).force).startswith("Spring(cubic=f64[], wall=Stop(mass=0, position=")
    assert eqx.tree_pformat(MACHINE).startswith("ImpactSystem(")
