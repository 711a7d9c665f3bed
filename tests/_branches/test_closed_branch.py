"""A closed branch: orbits of one impact in two periods beside a motion without impacts, all in closed form."""

import numpy as np
import one_impact
import pytest
import scipy.linalg
import scipy.optimize

import vijax as vx

pytestmark = pytest.mark.thorough

PERIODS, RESTITUTION, DAMPING_RATIO, PLACE = 2, 0.8, 0.03, 1.5


def machine(w: float) -> vx.ImpactSystem:
    return vx.models.impact_oscillator(
        w, position=PLACE, restitution=RESTITUTION, damping_ratio=DAMPING_RATIO
    )


def closed_form(w: float) -> tuple[np.ndarray, np.ndarray, complex]:
    """Quadratic for the impact speed v, response minus (PLACE, 0) at the impact for v = 1, amplitude of the response.

    (x, v) minus the response p is E times its value one flight earlier, E the matrix of the free motion, and p lies
    on the ellipse of the response.
    """
    damping, step = 2 * DAMPING_RATIO, np.array([0.0, 1.0])
    flight = scipy.linalg.expm(np.array([[0.0, 1.0], [-1.0, -damping]]) * PERIODS * 2 * np.pi / w)
    shift = np.linalg.solve(np.eye(2) - flight, step + RESTITUTION * flight @ step)
    amplitude = 1 / (1 - w * w + 1j * damping * w)
    square = shift[0] ** 2 + (shift[1] / w) ** 2
    return np.array([square, 2 * PLACE * shift[0], PLACE**2 - abs(amplitude) ** 2]), shift, amplitude


def discriminant(w: float) -> float:
    a, b, c = closed_form(w)[0]
    return b * b - 4 * a * c


def faster_orbit(w: float) -> vx.PeriodicOrbit:
    quadratic, shift, amplitude = closed_form(w)
    v = np.roots(quadratic).real.max()
    response = np.array([PLACE, 0.0]) + v * shift
    phase = np.angle((response[0] - 1j * response[1] / w) / amplitude) % (2 * np.pi)
    system = machine(w)
    sol = vx.simulate(system, phase / w, 2 * np.pi / w, [PLACE], [-RESTITUTION * v])
    return vx.periodic_orbit(system, sol.x1, sol.v1, PERIODS)


@pytest.mark.slow
def test_a_closed_branch_is_gone_round_once_between_its_folds():
    folds = [scipy.optimize.brentq(discriminant, *ends, xtol=1e-15) for ends in ((2.1, 2.4), (2.5, 2.9))]
    branch = vx.continuation(faster_orbit(2.45), "forcing.frequency", (1.8, 3.2), progress=False)
    assert branch.points.attrs["ends"] == '["closed", "closed"]'
    assert [point.kind for point in branch.bifurcations] == ["fold", "fold"]
    np.testing.assert_allclose(
        sorted(point.value for point in branch.bifurcations), folds, rtol=0, atol=1e-12
    )
    assert min(branch.values) > folds[0] - 1e-12
    assert max(branch.values) < folds[1] + 1e-12
    found = branch.points.impact_speed.values[:, 0]
    exact = [np.roots(closed_form(w)[0]).real for w in branch.values]
    error = [abs(roots - v).min() for roots, v in zip(exact, found, strict=True)]
    assert max(error) < 1e-7  # the square root of a rounding, at a fold
    # Both orbits of every frequency, the faster one stable.
    is_faster = np.array([v > roots.mean() for roots, v in zip(exact, found, strict=True)])
    is_inside = np.array([discriminant(w) > 1e-3 for w in branch.values])
    np.testing.assert_array_equal(branch.points.is_stable.values[is_inside], is_faster[is_inside])
    assert is_faster[is_inside].any()
    assert not is_faster[is_inside].all()


@pytest.mark.slow
def test_period_doublings_of_a_closed_branch_are_those_in_closed_form_wherever_it_is_begun():
    numbers, n = one_impact.Numbers(0.57, 0.9, 0.0255), 3

    def instability(w: float, sign: int) -> float:
        """Function that is zero where a multiplier is -1, for the faster orbit (sign 1) or the slower one (-1)."""
        at = one_impact.step(w, numbers, n, float(one_impact.speed(w, numbers, n, sign)))
        return 1 + np.trace(at) + np.linalg.det(at)

    def root(function, low, high, *args):
        return scipy.optimize.brentq(function, low, high, args, xtol=1e-14)

    folds = [
        root(lambda w: float(one_impact.discriminant(w, numbers, n)), *ends)
        for ends in ((3.1, 3.2), (5.0, 5.1))
    ]
    ws = np.linspace(folds[0] + 1e-4, folds[1] - 1e-4, 20)
    doublings = []
    for sign in (-1, 1):
        values = np.array([instability(w, sign) for w in ws])
        changes = np.flatnonzero(values[:-1] * values[1:] < 0)
        doublings += [root(instability, ws[k], ws[k + 1], sign) for k in changes]
    assert len(doublings) == 2
    for w, sign in ((3.4, 1), (3.9, 1), (3.6, -1)):
        start = one_impact.after_impact(w, numbers, n, float(one_impact.speed(w, numbers, n, sign)))
        orbit = vx.periodic_orbit(numbers.machine(w), *start, n, max_events=8)
        branch = vx.continuation(orbit, "forcing.frequency", (1.5, 5.5), progress=False)
        assert branch.ends == ("closed", "closed")
        assert sorted(point.kind for point in branch.bifurcations) == ["fold", "fold", "pd", "pd"]
        for kind, exact in (("fold", folds), ("pd", doublings)):
            found = sorted(point.value for point in branch.bifurcations if point.kind == kind)
            np.testing.assert_allclose(found, sorted(exact), rtol=0, atol=1e-11)


@pytest.mark.slow
def test_a_branch_is_not_closed_where_it_passes_its_start_at_a_distance():
    # A random machine: with its frequency the branch comes again to the plane across it at its start.
    force = vx.Harmonic(
        amplitude=[[1.1297646452817705], [0.2928791155040609], [0.8802476020653238]],
        frequency=0.3591218605,
        phase=[[0.23785907569749978], [1.3466225803308167], [1.0954533182373951]],
    )
    stop = vx.Stop(0, position=0.16683170070169234, restitution=0.695562474785925)
    system = vx.ImpactSystem(
        [1.2009000584405018], [[0.046019077181388486]], [[5.740262262824115]], force, [stop]
    )
    orbit = vx.periodic_orbit(system, [0.15902702], [0.15685901], 1)
    branch = vx.continuation(orbit, "forcing.frequency", (0.35, 0.42), progress=False)
    assert "closed" not in branch.ends
    assert branch.values.max() == pytest.approx(0.42)
    beyond = branch.points.isel(point=(branch.values > 0.4146) & (branch.points["is_stable"].values))
    assert ((beyond["event_stop"] >= 0).sum("event") == 5).any()


@pytest.mark.slow
def test_two_period_doublings_on_one_step_are_found():
    """A random machine: between two complex pairs the multipliers are real, and one is below -1 for half a per cent."""
    load = vx.Harmonic(
        [[0.566391], [0.0], [0.261071]], 1.2100689, [[4.66019], [0.0], [0.140038]], mean=[-0.114019]
    )
    system = vx.ImpactSystem([2.76029], [[0.0]], [[1.08134]], load, [vx.Stop(0, 0.635482, "upper", 0.856064)])
    branch = vx.continuation(
        vx.periodic_orbit(system, [-1.0845], [-0.5199], 3), "forcing.frequency", (0.8, 1.3), progress=False
    )
    assert branch.ends == ("closed", "closed")
    assert [point.kind for point in branch.bifurcations].count("pd") == 2
    least, most = sorted(point.value for point in branch.bifurcations if point.kind == "pd")
    inside = (branch.values > least) & (branch.values < most) & (branch.points["multipliers"][:, 0].real < 0)
    assert inside.any()
    assert (branch.points["multipliers"][inside, 0].real < -1).all()
