"""Branches of machines with friction of contacts, against simulation, closed forms and differences."""

import jax
import numpy as np
import pytest

import vijax as vx

# A program for each kind of machine takes a minute or two to compile.
pytestmark = pytest.mark.slow
FREQUENCY, COEFFICIENT = "forcing.frequency", "friction[0].coefficient"


def block(
    frequency: float = 0.65,
    coefficient: float | jax.Array = 0.35,
    *,
    lift: float = 0.5,
    push: float = 0.6,
    restitution: float = 0.5,
    springs: tuple[float, float] = (1.0, 0.0),
    dampers: tuple[float, float] = (0.1, 0.0),
) -> vx.ImpactSystem:
    """A block on a floor, driven along it and across it: coordinate 0 along it, coordinate 1 its height."""
    load = vx.Harmonic([push, lift], frequency, phase=[0.0, 0.9], mean=[0.0, -1.0])
    floor = vx.Contact({1: -1.0}, 0.0, restitution=restitution)
    rubbing = vx.Friction({0: 1.0}, coefficient=coefficient, contact=0)
    return vx.ImpactSystem([1.0, 1.0], np.diag(dampers), np.diag(springs), load, [floor], friction=[rubbing])


def bouncing(coefficient: float | jax.Array = 0.3, push: float = 0.6) -> vx.ImpactSystem:
    """The block on springs, shaken so hard that it bounces once a period."""
    return block(
        1.5, coefficient, lift=3.0, push=push, restitution=0.9, springs=(1.0, 0.3), dampers=(0.1, 0.05)
    )


def settled(system: vx.ImpactSystem, periods: int = 300) -> vx.PeriodicOrbit:
    sol = vx.simulate(system, 0.0, periods * system.forcing.period)
    return vx.periodic_orbit(system, sol.x1, sol.v1)


def followed_branch(orbit: vx.PeriodicOrbit, path: str, bounds: tuple[float, float]) -> vx.Branch:
    branch = vx.continuation(orbit, path, bounds, progress=False)
    assert branch.ends == ("bounds", "bounds")
    assert bool(branch.points["is_admissible"].all())
    return branch


def counts(system: vx.ImpactSystem) -> tuple[int, ...]:
    """Numbers of events of each kind in the last two of many periods of a run."""
    period = system.forcing.period
    sol = vx.simulate(system, 0.0, 60 * period, max_events=4096)
    kinds = np.asarray(sol.events.kind)[np.asarray(sol.events.t) > 58 * period]
    return tuple(int(np.count_nonzero(kinds == kind)) for kind in (vx.TURN, vx.STICK, vx.SLIP))


@pytest.fixture(scope="module")
def rubbing_orbit() -> vx.PeriodicOrbit:
    return settled(block())


@pytest.fixture(scope="module")
def rubbing_branch(rubbing_orbit) -> vx.Branch:
    return followed_branch(rubbing_orbit, FREQUENCY, (0.4, 1.4))


def test_a_block_sticks_at_its_turns_on_one_side_of_each_point_and_not_on_the_other(rubbing_branch):
    assert [point.kind for point in rubbing_branch.bifurcations] == ["crossing_sliding"] * 3
    for point in rubbing_branch.bifurcations:
        below, above = (counts(block(point.value + by)) for by in (-1e-5, 1e-5))
        assert below != above
        assert below[0] + below[1] == above[0] + above[1]  # a turn for a stick


def test_multipliers_are_those_of_the_period_map_by_differences(rubbing_branch):
    orbit = rubbing_branch.orbit(len(rubbing_branch) // 3)
    system, size = orbit.system, 1e-6

    def after(z: np.ndarray) -> np.ndarray:
        sol = vx.simulate(system, 0.0, orbit.period, z[:2], z[2:])
        return np.concatenate([sol.x1, sol.v1])

    # Along the floor alone: across it the block is held.
    start = np.concatenate([orbit.x0, orbit.v0])
    ways = size * np.eye(4)[[0, 2]]
    columns = [(after(start + way) - after(start - way)) / (2 * size) for way in ways]
    expected = np.linalg.eigvals(np.stack(columns, axis=1)[[0, 2]])
    found = np.asarray(orbit.multipliers)[:2]
    np.testing.assert_allclose(np.sort(np.abs(found)), np.sort(np.abs(expected)), atol=1e-7)


def test_lyapunov_exponents_are_logarithms_of_the_multipliers(rubbing_orbit):
    orbit = rubbing_orbit
    found = vx.lyapunov_exponents(
        orbit.system, orbit.x0, orbit.v0, transient=5, num_periods=20, progress=False
    )
    largest = np.log(np.abs(orbit.multipliers[0])) / orbit.period
    np.testing.assert_allclose(found[0], largest, rtol=1e-8)
    assert np.all(np.isneginf(found[1:]))


def test_the_onset_of_sticking_is_a_differentiable_function_of_the_coefficient(rubbing_branch):
    point = rubbing_branch.bifurcations[1]
    onset = lambda coefficient: vx.bifurcation_value(point, block(0.65, coefficient))  # noqa: E731
    assert float(onset(0.35)) == pytest.approx(point.value, rel=1e-10)
    step = 1e-5
    difference = (onset(0.35 + step) - onset(0.35 - step)) / (2 * step)
    assert float(jax.grad(onset)(0.35)) == pytest.approx(float(difference), rel=1e-7)


def grip_left(system: vx.ImpactSystem, orbit: vx.PeriodicOrbit) -> float:
    """What the impact leaves of the grip, from the simulated machine."""
    sol = vx.simulate(system, 0.0, orbit.period, orbit.x0, orbit.v0)
    (hit,) = np.flatnonzero(np.asarray(sol.events.kind) == vx.IMPACT)
    normal, rubbed = (
        abs(float(np.asarray(a)[hit])) for a in (sol.events.impulse, sol.events.friction_impulse)
    )
    return float(system.friction[0].slip) * normal - rubbed


@pytest.fixture(scope="module")
def bouncing_branch() -> vx.Branch:
    return followed_branch(settled(bouncing()), COEFFICIENT, (0.02, 0.8))


def test_a_branch_names_where_friction_begins_to_stick_within_an_impact(bouncing_branch):
    (point,) = bouncing_branch.bifurcations
    assert point.kind == "crossing_sliding"
    for by, sticks in ((-1e-4, False), (1e-4, True)):
        system = bouncing(point.value + by)
        orbit = vx.periodic_orbit(system, point.orbit.x0, point.orbit.v0)
        assert (grip_left(system, orbit) > 1e-9) == sticks
        # Friction that stops within the impact forgets its velocity.
        assert (np.min(np.abs(orbit.multipliers)) < 1e-12) == sticks


def test_the_stick_within_an_impact_is_a_differentiable_function_of_the_load(bouncing_branch):
    (point,) = bouncing_branch.bifurcations
    onset = lambda push: vx.bifurcation_value(point, bouncing(0.3, push))  # noqa: E731
    assert float(onset(0.6)) == pytest.approx(point.value, rel=1e-10)
    step = 1e-4
    difference = (onset(0.6 + step) - onset(0.6 - step)) / (2 * step)
    assert float(jax.grad(onset)(0.6)) == pytest.approx(float(difference), rel=1e-6)


def test_the_curve_of_the_stick_within_an_impact_is_a_line(bouncing_branch):
    """Normal and tangential motion share nothing: coefficient and push along the floor scale together."""
    (point,) = bouncing_branch.bifurcations
    push = "forcing.amplitude[0]"
    curve = vx.bifurcation_curve(point, push, {COEFFICIENT: (0.02, 0.8), push: (0.3, 1.0)}, progress=False)
    assert len(curve["point"]) > 10
    np.testing.assert_allclose(curve[COEFFICIENT] / curve[push], point.value / 0.6, rtol=1e-9)


def on_belt(velocity: float, coefficient: float = 0.2, static: float = 0.5) -> vx.ImpactSystem:
    """A block of weight 1 on a spring and a belt: figure 5 of friction of contacts."""
    weight = vx.Harmonic([0.0, 0.0], 0.0, mean=[0.0, -1.0])
    floor = vx.Contact({1: -1.0}, 0.0, restitution=0.0)
    rubbing = vx.Friction(
        {0: 1.0}, coefficient=coefficient, static_coefficient=static, contact=0, velocity=velocity
    )
    none = np.zeros((2, 2))
    return vx.ImpactSystem([1.0, 1.0], none, np.diag([1.0, 0.0]), weight, [floor], friction=[rubbing])


def test_a_block_on_a_belt_has_the_period_of_its_slip_and_stick_along_a_branch():
    orbit = vx.periodic_orbit(on_belt(0.3), [-1.0, 0.0], [0.0, 0.0])
    branch = vx.continuation(orbit, "friction[0].velocity", (0.1, 1.0), progress=False)
    assert branch.ends == ("bounds", "bounds")
    periods = np.pi + 2 * np.arctan(branch.values / 0.3) + 2 * 0.3 / branch.values
    np.testing.assert_allclose(branch.points["period"], periods, rtol=1e-13)


def test_a_block_on_a_belt_in_one_way_flutters_where_springs_couple_its_modes():
    # Figure 6 of friction of contacts, with damping c: eigenvalues of K are w^2 -+ i c w at the onset.
    angles, springs, contact, damping = np.deg2rad([150.0, 30.0]), [11.0, 20.0], 12.0, 0.1
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    stiffness = np.einsum("i,ij,ik->jk", springs, ways, ways)
    (kx, coupling), (_, ky) = stiffness
    difference = kx - ky - contact
    onset = (difference**2 + 4 * coupling**2 + 2 * damping**2 * (kx + ky + contact)) / (
        4 * coupling * contact
    )

    load = vx.Harmonic([0.02, 0.0], 3.0, mean=[0.0, -10.0])
    floor = vx.CompliantContact({1: -1.0}, 0.0, contact)
    brakes = [
        vx.ImpactSystem(
            [1.0, 1.0],
            damping * np.eye(2),
            stiffness,
            load,
            [floor],
            friction=[vx.Friction({0: 1.0}, coefficient=0.36, contact=0, velocity=velocity)],
        )
        for velocity in (50.0, -50.0)
    ]
    kinds = []
    for brake in brakes:
        rest = np.linalg.solve(stiffness, [0.0, -10.0])
        orbit = vx.periodic_orbit(brake, rest, [0.0, 0.0])
        branch = vx.continuation(orbit, COEFFICIENT, (0.3, 0.45), progress=False)
        kinds.append([point.kind for point in branch.bifurcations])
        if kinds[-1]:
            assert branch.bifurcations[0].value == pytest.approx(onset, rel=1e-9)
    assert sorted(kinds) == [[], ["ns"]]


def test_the_woodpecker_has_the_published_cycle_and_a_branch_in_the_restitution_of_its_beak():
    start = [0.0, -0.1034, -0.2788], [-0.3411, 0.0, -7.4583]
    toy = vx.models.woodpecker()
    sol = vx.simulate(toy, 0.0, 6.0, *start, max_events=2048)
    orbit = vx.periodic_orbit(toy, sol.x1, sol.v1)
    assert float(orbit.period) == pytest.approx(0.145976065144, rel=1e-11)
    np.testing.assert_allclose(orbit.progression, [-0.019445379, 0.0, 0.0], atol=1e-8)
    # The multipliers along the cycle and down the pole are 1; the slope of the map of falls is the third.
    np.testing.assert_allclose(orbit.multipliers[:3], [1.0, 1.0, -0.839156], atol=1e-6)
    assert bool(orbit.is_stable)
    branch = vx.continuation(orbit, "stops[0].restitution", (0.46, 0.62), progress=False)
    assert branch.ends == ("bounds", "bounds")
    for k in (0, len(branch) - 1):
        # From beside the orbit: at the upper end another stable one, of period 0.11657, has the start from above in its basin.
        x, v = branch.points["x0"].values[k], branch.points["v0"].values[k] * (1 + 1e-4)
        fall = vx.simulate(
            vx.models.woodpecker(restitution=branch.values[k]), 0.0, 12.0, x, v, max_events=4096
        )
        is_beat = (np.asarray(fall.events.stop) == 0) & (np.asarray(fall.events.kind) == vx.IMPACT)
        beats = np.asarray(fall.events.t)[is_beat]
        assert beats[-1] - beats[-2] == pytest.approx(float(branch.points["period"][k]), rel=1e-6)
