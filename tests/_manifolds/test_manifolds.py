"""Stable and unstable manifolds: straight lines of linear machines, invariance, boundaries of basins, cuts, refusals."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx
from vijax._manifolds.growth import ANGLE, CurveGrowth
from vijax._manifolds.reversal import StateMap

# A ball between walls, whose motion without impacts lies beside one with impacts; the saddle lies between them.
BALL = vx.models.two_sided_oscillator(3.0, damping_ratio=0.025)
WINDOW = {"x0[0]": (-0.5, 0.5), "v0[0]": (-3.0, 3.0)}
# Distances from a curve, in units of the least; the unstable multiplier is 9.7.
SHARES = (1.0, 1.5, 2.2, 3.3, 5.0)
FALLING = vx.ImpactSystem([1.0], [[0.1]], [[-1.0]], vx.Harmonic([0.3], 2.0))


@pytest.fixture(scope="module")
def saddle():
    return vx.periodic_orbit(BALL, [-0.496237], [-0.472257], 2)


@pytest.fixture(scope="module")
def curves(saddle):
    return vx.manifolds(saddle, length=15.0, spacing=0.03, bounds=WINDOW, progress=False)


def branch(ds, kind, side):
    """States (W x, v) of one branch, and the rows of its cuts."""
    one = ds.isel(branch=int(np.flatnonzero((ds["kind"] == kind) & (ds["side"] == side))[0]))
    states = np.stack([3.0 * one["x0"].values[:, 0], one["v0"].values[:, 0]], axis=1)
    return states[: int(np.flatnonzero(one["piece"] >= 0)[-1]) + 1]


@pytest.mark.slow
def test_manifolds_of_a_linear_machine_are_straight():
    orbit = vx.periodic_orbit(FALLING, [-0.06], [0.0])
    ds = vx.manifolds(orbit, length=3.0, spacing=0.1, progress=False)
    assert list(ds["kind"]) == ["unstable", "unstable", "stable", "stable"]
    assert list(ds["side"]) == [1, -1, 1, -1]
    assert set(ds["end"].values) == {"length"}
    # x = exp(s t) with s^2 + 0.1 s - 1 = 0
    slopes = {kind: -0.05 + sign * np.sqrt(0.0025 + 1) for kind, sign in (("unstable", 1), ("stable", -1))}
    np.testing.assert_allclose(ds["multiplier"], [np.exp(np.pi * slopes[str(k)]) for k in ds["kind"].values])
    for k, (kind, side) in enumerate(zip(ds["kind"].values, ds["side"].values, strict=True)):
        x, v = (ds[name].values[k, :, 0] - float(a[0]) for name, a in (("x0", orbit.x0), ("v0", orbit.v0)))
        is_state = np.isfinite(x)
        np.testing.assert_allclose(v[is_state], slopes[str(kind)] * x[is_state], atol=1e-12)
        assert (np.diff(side * x[is_state]) > 0).all()
        along = ds["arclength"].values[k][is_state]
        np.testing.assert_allclose(along, np.hypot(2 * x, v)[is_state], atol=1e-9)
        assert 2.9 < along[-1] <= 3.0
        assert np.diff(along).max() <= 0.1
        assert (ds["piece"].values[k][is_state] == 0).all()


def distance_to(curve, points):
    """Distances of points from a curve."""
    begin, chord = curve[:-1], np.diff(curve, axis=0)
    size = np.sum(chord**2, axis=1)
    is_chord = np.isfinite(size) & (size > 0)
    begin, chord, size = begin[is_chord], chord[is_chord], size[is_chord]
    share = np.clip(np.sum((points[:, None] - begin) * chord, axis=2) / size, 0, 1)
    return np.linalg.norm(points[:, None] - begin - share[..., None] * chord, axis=2).min(axis=1)


@pytest.mark.slow
def test_the_unstable_manifold_is_invariant_and_resolved(saddle, curves):
    forward = StateMap.of_orbit(saddle, 1)
    for side in (1, -1):
        states = branch(curves, "unstable", side)
        step = np.linalg.norm(np.diff(states, axis=0), axis=1)
        assert np.nanmax(step) <= 0.03
        grown = np.nancumsum(np.append(0.0, step))
        images = forward(states[(grown < 1.0) & np.isfinite(states).all(axis=1)], 2)
        assert np.linalg.norm(images - images[0], axis=1).max() > 0.5
        # Between two points the curve is this far from its chord.
        assert distance_to(states, images).max() < 0.03 * ANGLE / 4


@pytest.mark.slow
def test_unstable_states_come_from_the_saddle_and_stable_ones_go_to_it(saddle, curves):
    goal = np.array([3.0 * float(saddle.x0[0]), float(saddle.v0[0])])
    # On the way, an error is magnified by the other multiplier.
    for kind, sign, error in (("unstable", -1, 1e-3), ("stable", 1, 1e-5)):
        towards = StateMap.of_orbit(saddle, sign)
        for side in (1, -1):
            states = branch(curves, kind, side)
            early = states[: len(states) // 3]
            z = early[np.isfinite(early).all(axis=1)]
            away = [np.linalg.norm(z - goal, axis=1)]
            for _ in range(12):
                z = towards(z, 2)
                away.append(np.linalg.norm(z - goal, axis=1))
            assert np.nanmin(away, axis=0).max() < error


@pytest.mark.slow
def test_the_stable_manifold_is_the_boundary_of_the_basins(saddle, curves):
    forward = StateMap.of_orbit(saddle, 1)
    for side in (1, -1):
        states = branch(curves, "stable", side)[5:]
        before, here, after = states[:-2], states[1:-1], states[2:]
        chord = after - before
        is_known = np.isfinite(before + here + after).all(axis=1) & (np.linalg.norm(chord, axis=1) > 1e-2)
        here, chord = here[is_known][:80:2], chord[is_known][:80:2]
        across = 1e-6 * np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.linalg.norm(chord, axis=1)[:, None]
        beside = [forward(here + share * across, 150) for share in (*SHARES, *(-a for a in SHARES))]
        is_quiet = np.array(
            [np.abs(z[:, 1]) < 0.1 for z in beside]
        )  # the motion without impacts has v = 0.006
        one, other = is_quiet[: len(SHARES)], is_quiet[len(SHARES) :]
        # One side of the saddle goes to the motion without impacts. On the other one, the boundary is fractal.
        assert len(here) == 40
        assert (one.all(axis=0) ^ other.all(axis=0)).all()


@pytest.mark.slow
def test_curves_are_cut_where_velocities_are_reversed(curves):
    states = branch(curves, "unstable", -1)
    at = np.flatnonzero(np.isnan(states).any(axis=1))
    assert at.size
    before, after = states[at - 1], states[at + 1]
    is_hit = np.abs(np.abs(before[:, 0]) - 1.5) < 1e-6
    assert is_hit.any()
    ratio = after[is_hit, 1] / before[is_hit, 1]
    assert np.all((np.abs(ratio + 0.8) < 1e-4) | (np.abs(ratio + 1.25) < 1e-4))


@pytest.mark.slow
def test_bounds_hold(curves):
    for name, (low, high) in (("x0", (-0.5, 0.5)), ("v0", (-3.0, 3.0))):
        a = curves[name].values
        assert np.nanmin(a) >= low
        assert np.nanmax(a) <= high


@pytest.mark.slow
def test_all_points_of_an_orbit_have_manifolds(saddle):
    ds = vx.manifolds(saddle, which="unstable", length=2.0, all_points=True, progress=False)
    assert list(ds["period"]) == [0, 0, 1, 1]
    x, _ = vx.stroboscopic_map(BALL, saddle.x0, saddle.v0)
    np.testing.assert_allclose(ds["x0"].values[:, 0, 0], np.repeat([saddle.x0[0], x[0]], 2), atol=1e-10)


@pytest.mark.slow
def test_more_masses_have_a_curve_where_one_direction_is_unstable():
    system = vx.models.wagg_bishop_a(0.937219207774293)
    orbit = vx.periodic_orbit(system, [-0.0742205, -0.480415], [0.17675, 0.68982])
    ds = vx.manifolds(orbit, spacing=0.02, progress=False)
    assert list(ds["kind"]) == ["unstable", "unstable"]
    assert ds.sizes["mass"] == 2
    with pytest.raises(ValueError, match=r'3 of the 4 .* no curve: .* Or ask for `which="unstable"`'):
        vx.manifolds(orbit, which="stable")


@pytest.mark.slow
def test_stops_may_move():
    shaken = vx.Harmonic([0.05], 3.0, [1.0])
    stops = [vx.Stop(0, 0.5, "upper", 0.8, shaken), vx.Stop(0, -0.5, "lower", 0.8, shaken)]
    system = vx.ImpactSystem([1.0], [[0.05]], [[1.0]], vx.Harmonic([1.0], 3.0), stops)
    orbit = vx.periodic_orbit(system, [-0.370468], [0.663303])
    ds = vx.manifolds(orbit, length=3.0, spacing=0.05, progress=False)
    assert ds["arclength"].max("point").values.min() > 2.9
    towards, states = StateMap.of_orbit(orbit, 1), branch(ds, "stable", 1)[:20]
    goal = np.array([3.0 * float(orbit.x0[0]), float(orbit.v0[0])])
    away = [np.linalg.norm(towards(states, k) - goal, axis=1) for k in range(8)]
    assert np.min(away, axis=0).max() < 1e-5


@pytest.mark.thorough
def test_the_number_of_points_is_bounded(saddle):
    ds = vx.manifolds(saddle, which="unstable", spacing=1e-3, max_points=50, progress=False)
    assert list(ds["end"]) == ["points", "points"]
    assert ((ds["piece"] >= 0).sum("point") <= 50).all()


def test_ctrl_c_keeps_the_part(saddle, monkeypatch):
    whole, calls = CurveGrowth._refine, []

    def interrupted(self, *args):
        calls.append(self)
        if len(calls) > 8:
            raise KeyboardInterrupt
        return whole(self, *args)

    monkeypatch.setattr(CurveGrowth, "_refine", interrupted)
    with pytest.raises(vx.Interrupted) as stopped:
        vx.manifolds(saddle, which="unstable", progress=False)
    assert list(stopped.value.result["end"]) == ["interrupted"]
    assert int((stopped.value.result["piece"] >= 0).sum()) > 5


def test_orbits_without_curves_are_refused(saddle):
    quiet = replace_orbit(saddle, multipliers=jnp.array([0.8 + 0.3j, 0.8 - 0.3j]))
    with pytest.raises(
        ValueError, match=r"None of the 2 multipliers of the orbit lies outside .* no unstable"
    ):
        vx.manifolds(quiet)
    with pytest.raises(ValueError, match=r"2 of the 2 multipliers of the orbit lie inside .* is no curve"):
        vx.manifolds(quiet, which="stable")
    spiral = replace_orbit(saddle, multipliers=jnp.array([1.2 + 0.3j, 1.2 - 0.3j]))
    with pytest.raises(ValueError, match="2 of the 2 multipliers of the orbit lie outside"):
        vx.manifolds(spiral)
    with pytest.raises(ValueError, match=r"grazes a stop"):
        vx.manifolds(replace_orbit(saddle, multipliers=jnp.array([np.inf + 0j, 0.0 + 0j])))
    with pytest.raises(ValueError, match="does not follow this orbit"):
        vx.manifolds(replace_orbit(saddle, is_admissible=jnp.array(False)))
    held = replace_orbit(saddle, multipliers=jnp.array([3.0 + 0j, 0.0 + 0j]))
    with pytest.raises(ValueError, match="A mass sticks in the orbit"):
        vx.manifolds(held, which="stable")
    plastic = replace_orbit(saddle, system=vx.models.two_sided_oscillator(3.0, restitution=0.0))
    with pytest.raises(
        ValueError, match=r"no inverse.*restitution 0, ends alike.* Or ask for `which=\"unstable\"`"
    ):
        vx.manifolds(plastic, which="stable")


def replace_orbit(orbit, **new):
    return eqx.tree_at(lambda o: [getattr(o, name) for name in new], orbit, [*new.values()])


def test_arguments_that_do_not_fit_are_refused(saddle):
    with pytest.raises(ValueError, match='must be "unstable", "stable" or both'):
        vx.manifolds(saddle, which=())
    with pytest.raises(ValueError, match="`length` must be positive, but is -1"):
        vx.manifolds(saddle, length=-1.0)
    with pytest.raises(ValueError, match=r"`bounds` must be of x0\[0\], v0\[0\], but has v"):
        vx.manifolds(saddle, bounds={"v": (0, 1)})
    with pytest.raises(ValueError, match="must be a lower and a higher value"):
        vx.manifolds(saddle, bounds={"v0[0]": (1, 0)})
    with pytest.raises(ValueError, match="`max_points` must be a whole number, 2 or more"):
        vx.manifolds(saddle, max_points=1)
    at_rest = vx.periodic_orbit(replace_load(FALLING), [0.0], [0.0])
    with pytest.raises(ValueError, match="`length` must be positive: the saddle is at rest at 0"):
        vx.manifolds(at_rest)


def replace_load(system):
    return eqx.tree_at(lambda s: s.forcing, system, vx.Harmonic([0.0], 2.0))
