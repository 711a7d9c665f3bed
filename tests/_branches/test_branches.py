"""Branches of periodic orbits: published points, identities along them, their ends."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from helpers import counted

import vijax as vx

pytestmark = pytest.mark.thorough

AMPLITUDE, FREQUENCY = "forcing.amplitude[0]", "forcing.frequency"
# Event capacity for orbits of one mass, the same in all files: one program.
ROOM = 32


def oscillator(amplitude, frequency, damping=0.04, restitution=0.9):
    """One mass with unit stiffness and a stop at 1."""
    stop = vx.Stop(0, 1.0, "upper", restitution)
    return vx.ImpactSystem([1.0], [[damping]], [[1.0]], vx.Harmonic([amplitude], frequency), [stop])


def follow(orbit, path, low, high, **how):
    return vx.continuation(orbit, path, (low, high), progress=False, **how)


def points_of(branch, kind):
    return [point for point in branch.bifurcations if point.kind == kind]


@pytest.fixture(scope="module")
def doubled():
    """Branch of one impact in two periods, at 0.84091."""
    orbit = vx.periodic_orbit(oscillator(0.4, 0.84091), [0.43252758], [0.148], 2, max_events=ROOM)
    return follow(orbit, AMPLITUDE, 0.1, 0.5)


def grazing_amplitude(frequency, damping=0.04):
    return np.hypot(1 - frequency**2, damping * frequency)


def test_published_period_doubling_and_grazing(doubled):
    # R. Ghosh & D. J. W. Simpson, arXiv 2510.16218; digits recomputed. The grazing is in closed form.
    assert [point.kind for point in doubled.bifurcations] == ["gr", "pd"]
    grazing, doubling = doubled.bifurcations
    assert grazing.value == pytest.approx(grazing_amplitude(0.84091), abs=1e-11)
    assert np.isinf(grazing.orbit.multipliers[0])
    assert doubling.value == pytest.approx(0.32561956758361, abs=1e-11)
    orbit = doubling.orbit
    assert float(orbit.events.velocity_minus[0]) == pytest.approx(0.27433182278456, abs=1e-9)
    assert np.abs(orbit.multipliers + 1).min() < 1e-8


def test_every_point_is_an_orbit(doubled):
    assert bool(doubled.points.is_admissible.all())
    assert float(doubled.points.residual.max()) < 1e-13
    assert np.all(np.diff(doubled.points.arclength) >= 0)
    for k in range(0, len(doubled), 20):
        orbit = doubled.orbit(k)
        sol = vx.simulate(orbit.system, 0.0, orbit.period, orbit.x0, orbit.v0, max_events=16)
        np.testing.assert_allclose(sol.x1, orbit.x0, rtol=0, atol=1e-11)
        assert int(sol.num_events) == int(orbit.num_impacts.sum())


def test_multipliers_multiply_to_the_loss_of_volume(doubled):
    points = doubled.points.isel(point=doubled.points.bifurcation.values != "gr")  # one is infinite there
    loss = np.exp(-0.04 * 2 * 2 * np.pi / 0.84091) * 0.9 ** (2 * points.num_impacts.values[:, 0])
    np.testing.assert_allclose(points.multipliers.prod("multiplier").values.real, loss, rtol=1e-10)


def test_it_ends_on_its_bounds(doubled):
    assert doubled.ends == ("bounds", "bounds")
    assert doubled.values[0] == pytest.approx(0.1, abs=1e-15)
    assert doubled.values[-1] == pytest.approx(0.5, abs=1e-15)
    assert int(doubled.points.num_impacts[0].sum()) == 0


@pytest.mark.slow
def test_a_branch_begun_at_a_bifurcation_has_this_and_all_others(doubled):
    for start in doubled.bifurcations:
        branch = follow(start.orbit, AMPLITUDE, 0.1, 0.5)
        assert branch.ends == doubled.ends
        assert kinds_and_values(branch) == kinds_and_values(doubled)
        # One of its own, now given with the rounding errors of the last.
        (again,) = [point for point in branch.bifurcations if point.kind == start.kind]
        assert kinds_and_values(follow(again.orbit, AMPLITUDE, 0.1, 0.5)) == kinds_and_values(doubled)


def kinds_and_values(branch):
    found = sorted((point.kind, point.value) for point in branch.bifurcations)
    return [(kind, pytest.approx(value, abs=1e-10)) for kind, value in found]


@pytest.mark.slow
def test_a_doubled_branch_ends_where_it_began(doubled):
    (point,) = points_of(doubled, "pd")
    (orbit,) = vx.switch_branch(point)
    assert orbit.num_periods == 4
    sol = vx.simulate(orbit.system, 0.0, orbit.period, orbit.x0, orbit.v0)
    np.testing.assert_allclose(sol.x1, orbit.x0, rtol=0, atol=1e-11)
    branch = follow(orbit, AMPLITUDE, 0.32, 0.33)
    assert "period_doubling" in branch.ends
    # There it meets the branch of half the period, traversed twice.
    (end,) = points_of(branch, "bp")
    assert end.value == pytest.approx(point.value, abs=1e-15)
    assert np.abs(end.orbit.multipliers - 1).min() < 1e-8
    (half,) = vx.switch_branch(end)
    assert half.num_periods == 2
    assert float(vx.bifurcation_value(end, end.orbit.system)) == pytest.approx(point.value, abs=1e-12)


def test_families_of_several_periods_leave_a_grazing(doubled):
    """From the orbit without impacts: one impact in two periods (its doubling is published), both families of three."""
    alone = vx.periodic_orbit(oscillator(0.2, 0.84091), [0.0], [0.0], max_events=ROOM)
    (grazing,) = follow(alone, AMPLITUDE, 0.1, 0.5).bifurcations
    families = vx.switch_branch(grazing)
    assert [(orbit.num_periods, int(orbit.num_impacts[0])) for orbit in families] == [(2, 1), (3, 1), (3, 2)]
    for orbit in families:
        sol = vx.simulate(orbit.system, 0.0, orbit.period, orbit.x0, orbit.v0)
        assert int(sol.num_events) == int(orbit.num_impacts[0])
        assert abs(float(orbit.system.forcing.amplitude[0]) - grazing.value) < 1e-3
    (doubling,) = points_of(follow(families[0], AMPLITUDE, 0.29, 0.33), "pd")
    assert doubling.value == pytest.approx(0.32561956758361, abs=1e-11)
    # The branch of three periods begins and ends there. On one side it goes on without impacts, on the other nothing does.
    of_three, same = (follow(orbit, AMPLITUDE, 0.1, 0.5) for orbit in families[1:])
    assert sorted(of_three.ends) == sorted(same.ends) == ["bounds", "gr"]
    assert kinds_and_values(of_three) == kinds_and_values(same)
    assert len(points_of(of_three, "gr")) == 3
    changes = [(point.kind, round(point.value, 6)) for point in of_three.bifurcations if point.kind != "gr"]
    assert len(set(changes)) == len(changes) == 4
    # The same families leave the grazing of the branch of two periods, except that family itself.
    others = vx.switch_branch(points_of(doubled, "gr")[0])
    assert [(orbit.num_periods, int(orbit.num_impacts[0])) for orbit in others] == [(1, 1), (3, 1), (3, 2)]


def test_a_branch_without_any_event_has_orbits():
    alone = vx.periodic_orbit(oscillator(0.1, 0.84091), [0.0], [0.0], max_events=ROOM)
    branch = follow(alone, AMPLITUDE, 0.05, 0.2)
    orbit = branch.orbit(0)
    assert int(orbit.num_impacts.sum()) == 0
    assert np.all(orbit.events.kind == -1)
    assert np.hypot(orbit.x0, orbit.v0 / 0.84091)[0] == pytest.approx(0.05 / grazing_amplitude(0.84091))


def test_a_branch_is_kept_in_a_file(doubled, tmp_path):
    doubled.points.to_netcdf(tmp_path / "branch.nc")
    again = vx.Branch(xr.open_dataset(tmp_path / "branch.nc"))
    np.testing.assert_array_equal(again.values, doubled.values)
    assert [point.kind for point in again.bifurcations] == ["gr", "pd"]
    np.testing.assert_array_equal(again.orbit(-2).events.t, doubled.orbit(-2).events.t)
    assert repr(again) == repr(doubled)


def test_max_points_is_kept(doubled):
    branch = follow(doubled.orbit(-5), AMPLITUDE, 0.1, 0.5, max_points=3)
    assert len(branch) == 7
    assert branch.ends == ("max_points", "max_points")


def test_branches_side_by_side_are_those_followed_alone(doubled):
    # More branches than a batch is compiled for, from both sides of the bifurcations, and one with only a few points.
    orbits = [doubled.orbit(k) for k in (-5, 3, -20)]
    with counted() as compilations:
        together = follow(orbits, AMPLITUDE, 0.1, 0.5)
    # All calls use one program.
    assert "jit(look)" not in compilations
    for orbit, branch in zip(orbits, together, strict=True):
        alone = follow(orbit, AMPLITUDE, 0.1, 0.5)
        assert branch.ends == alone.ends == doubled.ends
        np.testing.assert_allclose(branch.values, alone.values, rtol=0, atol=1e-12)
        for point, same in zip(branch.bifurcations, doubled.bifurcations, strict=True):
            assert point.kind == same.kind
            assert point.value == pytest.approx(same.value, abs=1e-11)
    assert [len(branch) for branch in follow(orbits, AMPLITUDE, 0.1, 0.5, max_points=2)] == [5, 5, 5]


@pytest.mark.parametrize(
    ("orbit", "path", "bounds", "sentence"),
    [
        (-1, "forcing.amplitude", (0.1, 0.5), "names an array of shape"),
        (-1, AMPLITUDE, (0.1, 0.3), "does not lie within the bounds"),
        (-1, AMPLITUDE, (0.5, 0.1), "a lower and a higher value"),
        (-1, AMPLITUDE, (0.1, np.inf), "a lower and a higher value"),
        (-1, "stops[*].restitution", (0.5, 1.1), "`restitution`"),
        (-1, "forcing.speed", (0.1, 0.5), "names nothing"),
    ],
)
def test_bad_arguments_are_told(doubled, orbit, path, bounds, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.continuation(doubled.orbit(orbit), path, bounds, progress=False)
    with pytest.raises(IndexError, match="no point"):
        doubled.orbit(len(doubled))


def test_a_fold_beside_a_grazing():
    # The impact demo of COCO: the grazing is in closed form, the fold 3e-5 away from it.
    system = oscillator(1.0, 1.0, 0.1, 0.8)
    sol = vx.simulate(system, 0.0, 60 * system.forcing.period)
    orbit = vx.periodic_orbit(system, sol.x1, sol.v1, max_events=ROOM)
    assert float(orbit.events.velocity_minus[0]) == pytest.approx(1.6957329375949, abs=1e-12)
    branch = follow(orbit, AMPLITUDE, 0.01, 1.2)
    assert [point.kind for point in branch.bifurcations] == ["gr", "fold"]
    assert branch.bifurcations[0].value == pytest.approx(0.1, abs=1e-12)
    assert 1e-5 < branch.bifurcations[0].value - branch.bifurcations[1].value < 1e-4
    at = np.abs(branch.values - 0.2).argmin()
    near = follow(branch.orbit(int(at)), AMPLITUDE, 0.2, 1.2).orbit(0)
    assert float(near.events.velocity_minus[0]) == pytest.approx(0.29861285205633, abs=1e-12)


# Its bifurcations as functions of the machine


def grazing_of(doubled):
    """Load amplitude of the grazing, as a function of damping and frequency."""
    point = doubled.bifurcations[0]

    def value(numbers, amplitude=0.4):
        damping, frequency = numbers
        load, stop = vx.Harmonic(jnp.array([amplitude]), frequency), vx.Stop(0, 1.0, "upper", 0.9)
        system = vx.ImpactSystem([1.0], damping * jnp.eye(1), [[1.0]], load, [stop])
        return vx.bifurcation_value(point, system)

    return value


@pytest.mark.slow
def test_a_grazing_and_its_derivatives_are_those_of_the_closed_form(doubled):
    value, (damping, w) = grazing_of(doubled), (0.05, 0.83)
    numbers = jnp.array([damping, w])
    exact = grazing_amplitude(w, damping)
    with counted() as compilations:
        found = float(value(numbers))
    assert found == pytest.approx(exact, rel=1e-13)
    # The point is followed by the programs of its branch.
    assert "jit(look)" not in compilations
    slopes = damping * w**2 / exact, (-2 * w * (1 - w**2) + damping**2 * w) / exact
    np.testing.assert_allclose(jax.grad(value)(numbers), slopes, rtol=1e-12)


def test_the_parameter_itself_is_not_used(doubled):
    values = [grazing_of(doubled)(jnp.array([0.04, 0.84091]), amplitude) for amplitude in (0.1, 0.4)]
    assert float(values[0]) == float(values[1])


def retold(point, kind):
    """The point, relabelled as another kind."""
    names = point.branch.points["bifurcation"].astype("U32")
    names[point.index] = kind
    return vx.Bifurcation(vx.Branch(point.branch.points.assign(bifurcation=names)), point.index)


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [("pd", "another one twice"), ("chatter_completion", "infinitely many")],
)
def test_kinds_without_a_value_are_told(doubled, kind, sentence):
    with pytest.raises(ValueError, match=sentence):
        vx.bifurcation_value(retold(doubled.bifurcations[0], kind), oscillator(0.4, 0.84091))


def test_machines_of_another_make_have_no_value(doubled):
    with pytest.raises(ValueError, match="like that of the point, with 1 masses"):
        vx.bifurcation_value(doubled.bifurcations[0], vx.models.wagg_bishop_b(0.9))


def specials(curve):
    """Names and both parameters of the special points of a curve."""
    return [
        (str(name), *(float(curve[path].values[k]) for path in curve.coords))
        for k, name in enumerate(curve.special.values)
        if name
    ]


def test_curves_of_two_parameters(doubled):
    bounds = {AMPLITUDE: (0.1, 0.5), FREQUENCY: (0.78, 0.9)}
    grazing, doubling = doubled.bifurcations
    curve = vx.bifurcation_curve(grazing, FREQUENCY, bounds, progress=False)
    assert curve.attrs["ends"] == '["bounds", "bounds"]'
    np.testing.assert_allclose(
        curve[AMPLITUDE], grazing_amplitude(curve[FREQUENCY].values), rtol=0, atol=1e-12
    )
    # An impact without speed does not affect the next one where free oscillations fit into the period.
    ((name, amplitude, frequency),) = specials(curve)
    assert name == "resonant_grazing"
    exact = 4 * np.sqrt(1 - 0.02**2) / 5
    assert frequency == pytest.approx(exact, abs=1e-12)
    assert amplitude == pytest.approx(grazing_amplitude(exact), abs=1e-12)
    curve = vx.bifurcation_curve(doubling, FREQUENCY, bounds, progress=False)
    last = curve.isel(point=int(curve[FREQUENCY].values.argmax()))
    assert float(last[FREQUENCY]) == pytest.approx(0.9, abs=1e-12)
    assert float(last[AMPLITUDE]) == pytest.approx(0.35421999760770, abs=1e-11)
    # Curves of period doublings also begin there.
    assert curve.attrs["ends"] == '["resonant_grazing", "bounds"]'
    np.testing.assert_allclose(specials(curve)[0][1:], (grazing_amplitude(exact), exact), rtol=0, atol=1e-12)
    inside = curve.multipliers.values[curve.special.values == ""]
    np.testing.assert_allclose(np.abs(inside + 1).min(axis=1), 0, atol=1e-6)
    with pytest.raises(ValueError, match="must be of"):
        vx.bifurcation_curve(doubling, FREQUENCY, {AMPLITUDE: (0.1, 0.5)}, progress=False)
    with pytest.raises(ValueError, match="`path` must be another"):
        vx.bifurcation_curve(doubling, AMPLITUDE, bounds, progress=False)


@pytest.mark.slow
def test_two_curves_meet_in_one_point():
    # Two curves: a fold up to where two impacts coincide, and orbits with two simultaneous impacts.
    orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
    double_impact, fold = follow(orbit, FREQUENCY, 0.8, 1.0).bifurcations[:2]
    bounds = {FREQUENCY: (0.9, 1.12), "stops[0].position": (0.1, 0.31)}
    first, second = (
        vx.bifurcation_curve(point, "stops[0].position", bounds, progress=False)
        for point in (fold, double_impact)
    )
    (met,) = specials(first)
    assert met[0] == "double_impact+fold"
    assert first.attrs["ends"].startswith('["double_impact+fold"')
    (other,) = [point for point in specials(second) if abs(point[1] - met[1]) < 1e-3]
    assert other[0] == met[0]
    np.testing.assert_allclose(other[1:], met[1:], rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frequency", "kind", "amplitude", "speed"),
    [
        (0.90, "pd", 0.35421999760770, 0.74714667673068),
        (0.7995, "fold", 0.36218601300675, 0.050393232377),
        (0.79, "fold", 0.35564119904136, 1.2228091254396),
    ],
)
def test_published_points_at_other_frequencies(doubled, frequency, kind, amplitude, speed):
    # As above. The orbit is followed to this frequency along a branch.
    first = doubled.orbit(-20)
    over = follow(first, FREQUENCY, min(frequency, 0.84), max(frequency, 0.85))
    orbit = over.orbit(0 if frequency < 0.84 else -1)
    branch = follow(orbit, AMPLITUDE, 0.1, 0.5)
    point = min(points_of(branch, kind), key=lambda point: abs(point.value - amplitude))
    assert point.value == pytest.approx(amplitude, abs=1e-10)
    assert np.nanmin(np.abs(point.orbit.events.velocity_minus - speed)) < 1e-10


@pytest.mark.slow
def test_case_a_through_all_its_changes():
    orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
    branch = follow(orbit, FREQUENCY, 0.4, 2.0)
    assert branch.ends == ("bounds", "bounds")
    assert bool(branch.points.is_admissible.all())
    for start in branch.bifurcations:
        assert kinds_and_values(follow(start.orbit, FREQUENCY, 0.4, 2.0)) == kinds_and_values(branch)
    known = [("double_impact", 0.92412181968), ("fold", 0.97629345465), ("gr", 0.88866279078)]
    found = [(point.kind, point.value) for point in branch.bifurcations]
    start = next(k for k, (_, value) in enumerate(found) if abs(value - known[0][1]) < 1e-9)
    for (kind, value), (expected_kind, expected) in zip(found[start:], known, strict=False):
        assert kind == expected_kind
        assert value == pytest.approx(expected, abs=1e-10)
    # A grazing has an infinite multiplier as an orbit with that impact, not as the orbit that only touches the stop.
    for grazing in points_of(branch, "gr"):
        touches = np.any(np.abs(grazing.orbit.events.velocity_minus) < 1e-12)
        assert np.isinf(grazing.orbit.multipliers[0]) == touches


@pytest.mark.slow
def test_case_b_a_fold_and_a_doubling_close_together():
    system = vx.models.wagg_bishop_b(1.2)
    sol = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=4000)
    branch = follow(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, 1.05, 1.3)
    (doubling,) = [point for point in points_of(branch, "pd") if abs(point.value - 1.0772831602) < 1e-6]
    (fold,) = [point for point in points_of(branch, "fold") if abs(point.value - 1.0772782603) < 1e-6]
    assert 4.5e-6 < doubling.value - fold.value < 5.5e-6


@pytest.mark.slow
def test_sticking_orbits_to_where_their_sticks_vanish():
    system = vx.models.wagg_bishop_b(0.65)
    sol = vx.simulate(system, 0.0, 200 * system.forcing.period, max_events=40_000)
    branch = follow(vx.periodic_orbit(system, sol.x1, sol.v1), FREQUENCY, 0.6, 0.7)
    assert branch.ends == ("chatter_completion", "chatter_completion")
    assert np.all(branch.points.multipliers.values[:, -2:] == 0)
    (doubling,) = points_of(branch, "pd")
    assert doubling.value == pytest.approx(0.6655881174, abs=1e-8)
