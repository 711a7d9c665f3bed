"""Bifurcations as functions of the machine: published derivatives, closed forms, differences, failures.

Refused arguments, and a grazing in closed form, are tested with the branches, which share their programs.
"""

import os
import subprocess
import sys
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough
FREQUENCY = "forcing.frequency"
# All machines here are two masses with an upper stop each, so that they share their programs.


def pair(numbers, frequency=1.0):
    """Two masses in a chain.

    Args:
        numbers: amplitude on the first mass, both stiffnesses, damping of both, restitution of both stops, their
            positions, the second mass.
        frequency: of the load.
    """
    amplitude, first, second, damping, restitution, near, far, mass = numbers
    stops = [vx.Stop(0, near, "upper", restitution), vx.Stop(1, far, "upper", restitution)]
    load = vx.Harmonic(amplitude * jnp.array([1.0, 0.0]), frequency)
    return vx.chain(jnp.stack([1.0, mass]), damping * jnp.ones(2), jnp.stack([first, second]), load, stops)


def case_a(numbers):
    """Case (a) of Wagg & Bishop (2004), by factors on the load and K, both restitutions and the position of stop 0."""
    amplitude, restitution, near, stiffness = numbers
    return pair((0.3 * amplitude, stiffness, stiffness, 0.1, restitution, near, 0.3, 1.0))


def alone(numbers):
    """One mass with k = 1, by its damping and its load amplitude, and a second one without load or coupling."""
    damping, amplitude = numbers
    stops = [vx.Stop(0, 1.0, "upper", 0.9), vx.Stop(1, 1.0, "upper", 0.9)]
    load = vx.Harmonic(amplitude * jnp.array([1.0, 0.0]), 0.8)
    return vx.ImpactSystem([1.0, 1.0], damping * jnp.eye(2), np.eye(2), load, stops)


def pressed(numbers):
    """A mass that a constant load presses on its stop, and a driven one beside it, by both loads."""
    constant, amplitude = numbers
    load = vx.Harmonic(amplitude * jnp.array([0.0, 1.0]), 0.7, mean=constant * jnp.array([1.0, 0.0]))
    stops = [vx.Stop(0, 0.0, "upper", 0.8), vx.Stop(1, 100.0, "upper", 0.8)]
    return vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, stops)


CASE_A = np.array([1.0, 0.7, 0.3, 1.0])
UNEQUAL = np.array([1.0, 1.0, 1.1, 0.02, 0.8, 0.11, 100.0, 1.29])
ALONE = np.array([0.04, 0.4])
PRESSED = np.array([0.3, 0.1])


def branch_of(system, bounds):
    """Branch of the motion on which the machine settles."""
    sol = vx.simulate(system, 0.0, 300 * system.forcing.period, max_events=2000)
    return vx.continuation(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, bounds, progress=False)


MACHINES = {
    case_a: (vx.models.wagg_bishop_a(0.9), (0.85, 1.0)),
    pair: (pair(UNEQUAL, 1.65), (1.55, 1.715)),
    alone: (alone(ALONE), (0.77, 0.81)),
    pressed: (pressed(PRESSED), (0.69, 0.83)),
}


@cache
def points_of(make):
    """Bifurcations of a machine by kind."""
    return {point.kind: point for point in branch_of(*MACHINES[make]).bifurcations}


KINDS = [
    (case_a, CASE_A, "fold"),
    (case_a, CASE_A, "gr"),
    (case_a, CASE_A, "double_impact"),
    (pair, UNEQUAL, "ns"),
    (pair, UNEQUAL, "pd"),
    (alone, ALONE, "gr"),  # in closed form below
    (pressed, PRESSED, "force_zero"),
]


def value_of(make, kind):
    """Bifurcation value as a function of the numbers of a machine."""
    return lambda numbers: vx.bifurcation_value(points_of(make)[kind], make(numbers))


@pytest.mark.slow
def test_published_derivatives_of_a_fold():
    # Case (a), one impact of each mass a period.
    slopes = jax.grad(value_of(case_a, "fold"))(CASE_A)
    np.testing.assert_allclose(slopes, [0.21929349, 0.36316911, -1.11734516, 0.26171178], rtol=0, atol=5e-9)


@pytest.mark.parametrize(("make", "numbers", "kind"), KINDS)
@pytest.mark.slow
def test_the_value_of_the_same_machine_is_that_of_the_point(make, numbers, kind):
    value = value_of(make, kind)(numbers)
    assert float(value) == pytest.approx(points_of(make)[kind].value, rel=1e-13)


@pytest.mark.parametrize(("make", "numbers", "kind"), KINDS)
@pytest.mark.slow
def test_derivatives_are_those_of_differences(make, numbers, kind):
    value, h = value_of(make, kind), 2e-4
    slopes, direction = jax.grad(value)(numbers), np.linspace(-1, 1, len(numbers))
    for k, slope in enumerate(slopes):
        shifted = [float(value(numbers + s * h * (np.arange(len(numbers)) == k))) for s in (-2, -1, 1, 2)]
        difference = np.dot([1, -8, 8, -1], shifted) / (12 * h)
        assert float(slope) == pytest.approx(difference, rel=1e-9, abs=1e-9)
    _, forward = jax.jvp(value, (numbers,), (direction,))
    assert float(forward) == pytest.approx(float(slopes @ direction), rel=1e-12)


@pytest.mark.slow
def test_grazing_in_closed_form():
    # The amplitude of the position is that of the load over sqrt((1 - w^2)^2 + c^2 w^2). Grazing is where it is 1.
    damping, amplitude = ALONE
    w = float(value_of(alone, "gr")(ALONE))
    assert (1 - w**2) ** 2 + (damping * w) ** 2 == pytest.approx(amplitude**2, rel=1e-13)
    by_w = -4 * w * (1 - w**2) + 2 * damping**2 * w
    exact = [-2 * damping * w**2 / by_w, 2 * amplitude / by_w]
    np.testing.assert_allclose(jax.grad(value_of(alone, "gr"))(ALONE), exact, rtol=1e-12)


@pytest.mark.slow
def test_a_force_that_touches_zero_in_closed_form():
    # The driven mass gives the force of the spring and damper on the other one, which the constant load just exceeds.
    constant, amplitude = PRESSED
    w = float(value_of(pressed, "force_zero")(PRESSED))
    stiffness, of_link = (1 - w**2) ** 2 + 0.01 * w**2, 1 + 0.01 * w**2
    assert constant**2 * stiffness == pytest.approx(amplitude**2 * of_link, rel=1e-13)
    by_w = constant**2 * (-4 * w * (1 - w**2) + 0.02 * w) - amplitude**2 * 0.02 * w
    exact = [-2 * constant * stiffness / by_w, 2 * amplitude * of_link / by_w]
    slopes = jax.grad(value_of(pressed, "force_zero"))(PRESSED)
    np.testing.assert_allclose(slopes, exact, rtol=1e-12)


@pytest.mark.slow
def test_the_value_of_another_machine_is_that_of_its_branch():
    changed = CASE_A + np.array([0.02, -0.01, 0.003, 0.01])
    system = eqx.tree_at(lambda s: s.forcing.frequency, case_a(changed), jnp.asarray(0.9))
    found = {point.kind: point.value for point in branch_of(system, (0.85, 1.0)).bifurcations}
    for kind in ("fold", "gr", "double_impact"):
        value = float(value_of(case_a, kind)(changed))
        assert value == pytest.approx(found[kind], rel=1e-12)
        assert abs(value - points_of(case_a)[kind].value) > 1e-4


@pytest.mark.slow
def test_derivatives_of_a_batch_under_jit():
    points_of(case_a)  # branches need known numbers
    value = value_of(case_a, "gr")
    several = jnp.stack([CASE_A, CASE_A * np.array([1.01, 1.0, 1.0, 1.0])])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(value)))(several)
    np.testing.assert_allclose(values, [float(value(numbers)) for numbers in several], rtol=1e-13)
    np.testing.assert_allclose(slopes[1], jax.grad(value)(several[1]), rtol=0, atol=1e-12)


# On one core XLA converts a program in another order.
ON_ONE_CORE = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import jax
import vijax as vx
jax.config.update("jax_enable_x64", True)
machine = lambda damping: vx.models.impact_oscillator(0.8, position=1.2, damping_ratio=damping)
run = vx.simulate(machine(0.2), 0.0, 1000.0)
orbit = vx.periodic_orbit(machine(0.2), run.x1, run.v1)
branch = vx.continuation(orbit, "forcing.frequency", (0.4, 0.9), progress=False)
point = next(a for a in branch.bifurcations if a.kind == "gr")
value = lambda damping: vx.bifurcation_value(point, machine(damping))
print(jax.jit(jax.value_and_grad(value))(0.2)[0] - point.value)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs the cores of a process")
def test_values_under_jit_on_one_core():
    run = subprocess.run([sys.executable, "-c", ON_ONE_CORE], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert abs(float(run.stdout)) < 1e-12


@pytest.mark.slow
def test_second_derivatives_are_those_of_first_ones():
    value, h = value_of(alone, "gr"), 1e-4
    slope = lambda amplitude: jax.jvp(value, (jnp.stack([ALONE[0], amplitude]),), (jnp.array([0.0, 1.0]),))[1]  # noqa: E731
    amplitude = ALONE[1]
    _, second = jax.jvp(slope, (amplitude,), (1.0,))
    difference = (slope(amplitude + h) - slope(amplitude - h)) / (2 * h)
    assert float(second) == pytest.approx(float(difference), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "kind", "numbers", "sentence"),
    [
        (alone, "gr", np.array([0.5, 0.1]), "no such bifurcation"),
        pytest.param(
            pair,
            "pd",
            np.where(UNEQUAL == 100, -0.5, UNEQUAL),
            "does not follow the orbit",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_is_not_found_is_told(make, kind, numbers, sentence):
    with pytest.raises(vx.SimulationError, match=sentence):
        value_of(make, kind)(numbers)
    value = lambda numbers: vx.bifurcation_value(points_of(make)[kind], make(numbers), throw=False)  # noqa: E731
    assert np.isnan(value(numbers))
    assert np.isnan(jax.grad(value)(numbers)[:2]).all()  # the equations do not contain a stop that is not hit
