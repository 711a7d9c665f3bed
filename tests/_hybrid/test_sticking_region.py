"""Region S and its exit boundary agree with sticking and release in simulations."""

from collections.abc import Iterator
from functools import cache

import jax
import numpy as np
import pytest
from helpers import load_scene

import vijax as vx

# Rounding of some thousand steps, for forces of order one.
ROUNDING = 1e-12
SAME_INSTANT = 1e-12
SAMPLES = 40
# Fig. 12: frequencies at which the second mass of case (b) sticks.
FREQUENCIES = [0.1, 0.14, 0.18, 0.22, 0.26, 0.3, 0.36]
SCENES = [
    pytest.param("n3_three_held", marks=pytest.mark.slow),
    pytest.param("n2_release_by_impact_mix", marks=pytest.mark.slow),
    "n2_release_by_impact_chatter",
    "paper_b_om020",
]


@cache
def case_b(frequency: float) -> vx.Solution:
    return vx.simulate(vx.models.wagg_bishop_b(frequency), 0.0, 6 * 2 * np.pi / frequency)


@cache
def scene(name: str) -> tuple[vx.ImpactSystem, vx.Solution, list[int]]:
    golden = load_scene(name)
    return golden.system, golden.simulate(), golden.held_at_start


def events(sol: vx.Solution) -> list[tuple[float, int, int]]:
    log, n = sol.events, int(sol.num_events)
    return list(zip(*(np.asarray(a)[:n].tolist() for a in (log.t, log.kind, log.stop)), strict=True))


def held_spans(sol: vx.Solution, start: list[int]) -> Iterator[tuple[float, float, tuple[int, ...]]]:
    """Time spans between events in which some stops hold their masses."""
    begin, held = float(sol.t0), set(start)
    for t, kind, stop in [*events(sol), (float(sol.t1), vx.IMPACT, -1)]:
        if held and t > begin:
            yield begin, t, tuple(sorted(held))
        begin, held = t, held | {stop} if kind == vx.STICK else held - {stop} if kind == vx.RELEASE else held


def releases(sol: vx.Solution, start: list[int]) -> Iterator[tuple[float, int, tuple[int, ...], bool]]:
    """Time, stop, stops that held until then, and simultaneous impact, of every release."""
    held, log = set(start), events(sol)
    for t, kind, stop in log:
        until = held
        if kind == vx.RELEASE:
            together = {s for u, k, s in log if k == vx.RELEASE and abs(u - t) < SAME_INSTANT}
            is_hit = any(k == vx.IMPACT and abs(u - t) < SAME_INSTANT for u, k, _ in log)
            yield t, stop, tuple(sorted(until | together)), is_hit
            held = held - {stop}
        elif kind == vx.STICK:
            held = held | {stop}


@cache
def region_of(name: str, held: tuple[int, ...]) -> vx.StickingRegion:
    return vx.sticking_region(scene(name)[0], held)


def at(sol: vx.Solution, region: vx.StickingRegion, t) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Phase, and positions and velocities of the free masses."""
    x, v = sol.evaluate(t)
    free = list(region.free)
    return np.asarray(sol.machine.frequency * t), np.asarray(x)[..., free], np.asarray(v)[..., free]


def test_the_boundary_of_fig_12_is_the_line_of_the_paper():
    region = vx.sticking_region(vx.models.wagg_bishop_b(0.2), held=1)
    a, b, c = (np.asarray(value) for value in (region.x_normal, region.v_normal, region.level(0.0)))
    assert region.free == (0,)
    assert b > 0
    # v = -(a / b) x + c / b, and S above it.
    np.testing.assert_allclose([-a[0, 0] / b[0, 0], c[0] / b[0, 0]], [-10, 1], rtol=1e-15)
    np.testing.assert_array_equal(region.level(np.linspace(0, 6, 5)), np.full((5, 1), c[0]))


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_the_sticking_orbits_of_fig_12_end_on_the_line(frequency):
    sol = case_b(frequency)
    region = vx.sticking_region(vx.models.wagg_bishop_b(frequency), held=1)
    let_go = [release for release in releases(sol, []) if release[1] == 1]
    assert len(let_go) >= 4
    for t, _, _, is_hit in let_go:
        phase, x, v = at(sol, region, t)
        assert not is_hit
        assert abs(v[0] - (-10 * x[0] + 1)) < ROUNDING
        assert region.contact_force_rate(phase, x, v)[0] < 0


def test_the_forces_are_those_of_eqs_31_and_36():
    system, rng = vx.models.wagg_bishop_b(0.7), np.random.default_rng(1)
    k, c, s1, s2, amplitude = 1.0, 0.1, -0.3, 0.1, 0.5
    phase, x, v = rng.uniform(0, 6, 30), rng.normal(size=(30, 1)), rng.normal(size=(30, 1))
    on_first = c * v[:, 0] + k * (x[:, 0] - 2 * s1) + amplitude * np.cos(phase)
    on_second = c * v[:, 0] + k * (x[:, 0] - s2)
    lower, upper = vx.sticking_region(system, held=0), vx.sticking_region(system, held=[1])
    np.testing.assert_allclose(lower.contact_force(phase, x, v)[:, 0], -on_first, atol=1e-15, rtol=0)
    np.testing.assert_allclose(upper.contact_force(phase, x, v)[:, 0], on_second, atol=1e-15, rtol=0)


@pytest.mark.parametrize("held", [0, 1])
def test_sticking_motions_are_those_of_eqs_30_to_38(held):
    frequency = 0.2
    sol = case_b(frequency)
    spans = [span for span in held_spans(sol, []) if span[2] == (held,) and span[1] - span[0] > 0.5]
    assert len(spans) >= 5
    region = vx.sticking_region(vx.models.wagg_bishop_b(frequency), held)
    for begin, end, _ in spans:
        t = np.linspace(begin, end, SAMPLES, endpoint=False)
        phase, x, v = at(sol, region, t)
        # x'' + 2 a x' + w^2 x = constant + A cos(W t): Eq. 30 with w = 1, Eq. 35 with w = sqrt(2).
        a, w2, rest, load = (0.05, 1.0, -0.3, 0.0) if held == 0 else (0.1, 2.0, 0.05, 0.5)
        steady = load / (w2 - frequency**2 + 2j * a * frequency)
        wave = steady * np.exp(1j * phase)
        w = np.sqrt(w2 - a**2)
        c1 = x[0, 0] - rest - wave[0].real
        c2 = (v[0, 0] - (1j * frequency * wave[0]).real + a * c1) / w
        tau = t - begin
        expected = rest + wave.real + np.exp(-a * tau) * (c1 * np.cos(w * tau) + c2 * np.sin(w * tau))
        np.testing.assert_allclose(x[:, 0], expected, atol=ROUNDING, rtol=0)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.slow
def test_every_release_happens_on_the_exit_boundary_or_by_an_impact(name):
    _, sol, start = scene(name)
    found = list(releases(sol, start))
    assert len(found) >= 3
    for t, stop, held, is_hit in found:
        region = region_of(name, held)
        where = at(sol, region, t)
        force, rate = (f(*where)[held.index(stop)] for f in (region.contact_force, region.contact_force_rate))
        if is_hit and force < -ROUNDING:
            continue
        assert abs(force) < ROUNDING
        assert rate < 0


def test_an_impact_can_throw_a_mass_out_of_the_region():
    name = "n2_release_by_impact_chatter"
    _, sol, start = scene(name)
    thrown = []
    for t, _, held, is_hit in releases(sol, start):
        region = region_of(name, held)
        if is_hit:
            thrown.append(region.contact_force(*at(sol, region, t)))
    assert thrown
    assert all(np.min(force) < -1e-3 for force in thrown)


@pytest.mark.parametrize("name", SCENES)
def test_held_masses_are_inside_the_region_and_pressed_as_the_simulation_says(name):
    _, sol, start = scene(name)
    spans = list(held_spans(sol, start))
    assert spans
    seen = set()
    for begin, end, held in spans:
        seen.add(len(held))
        t = begin + (end - begin) * (np.arange(SAMPLES) + 0.5) / SAMPLES
        region = region_of(name, held)
        where = at(sol, region, t)
        assert np.all(region.contains(*where))
        force = np.asarray(sol.contact_force(t))[:, list(held)]
        np.testing.assert_allclose(region.contact_force(*where), force, atol=ROUNDING, rtol=ROUNDING)
    assert max(seen) == (3 if name == "n3_three_held" else 1)


def four_masses(rng: np.random.Generator) -> vx.ImpactSystem:
    """A machine with full matrices, two harmonics, a constant force and some stops."""
    c, k = rng.normal(size=(2, 4, 4))
    load = vx.Harmonic(rng.normal(size=(2, 4)), 1.3, rng.normal(size=(2, 4)), rng.normal(size=4))
    stops = [
        vx.Stop(2, 0.4, "upper", 0.5),
        vx.Stop(0, -0.2, "lower", 0.5),
        vx.Stop(2, -0.7, "lower", 0.5),
        vx.Stop(3, 0.1, "upper", 0.0),
    ]
    return vx.ImpactSystem(rng.uniform(0.5, 2, 4), c @ c.T, k @ k.T, load, stops)


@pytest.mark.parametrize("held", [(0,), (2, 1), (3, 0, 1)])
def test_force_and_rates_are_those_of_the_reduced_equations(held):
    rng = np.random.default_rng(7)
    system = four_masses(rng)
    region = vx.sticking_region(system, held)
    # Reduced equations as z' = A z, with z = (x, v, cosines, sines, 1) and the force as a row of it.
    free = np.array([i for i in range(4) if i not in {system.stops[j].mass for j in held}])
    assert region.free == tuple(free)
    m, c, k = (np.asarray(a) for a in (system.mass, system.damping, system.stiffness))
    anchored = np.zeros(4)
    for j in held:
        anchored[system.stops[j].mass] = system.stops[j].position
    amplitude, phases = np.asarray(system.forcing.amplitude), np.asarray(system.forcing.phase)
    f = len(free)
    rows = np.hstack(
        [
            -k[:, free],
            -c[:, free],
            (amplitude * np.cos(phases)).T,
            -(amplitude * np.sin(phases)).T,
            (np.asarray(system.forcing.mean) - k @ anchored)[:, None],
        ]
    )
    a = np.zeros((2 * f + 5, 2 * f + 5))
    a[:f, f : 2 * f] = np.eye(f)
    a[f : 2 * f] = rows[free] / m[free][:, None]
    speed = np.diag([1.3, 2.6])
    a[2 * f : 2 * f + 2, 2 * f + 2 : 2 * f + 4] = -speed
    a[2 * f + 2 : 2 * f + 4, 2 * f : 2 * f + 2] = speed
    towards = np.array([system.stops[j].sign * rows[system.stops[j].mass] for j in held])
    for _ in range(5):
        phase, x, v = rng.uniform(0, 6), rng.normal(size=f), rng.normal(size=f)
        waves = [np.cos(phase), np.cos(2 * phase), np.sin(phase), np.sin(2 * phase)]
        z = np.concatenate([x, v, waves, [1.0]])
        force = region.contact_force(phase, x, v)
        np.testing.assert_allclose(force, towards @ z, atol=ROUNDING, rtol=ROUNDING)
        rate = region.contact_force_rate(phase, x, v)
        np.testing.assert_allclose(rate, towards @ a @ z, atol=ROUNDING, rtol=ROUNDING)
        half_spaces = region.x_normal @ x + region.v_normal @ v - region.level(phase)
        np.testing.assert_allclose(half_spaces, force, atol=ROUNDING, rtol=ROUNDING)


def held_at_once(system: vx.ImpactSystem, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Test whether starts at rest on the stops stick there in `simulate`, (starts, stops)."""
    return np.array([vx.simulate(system, 0.0, 0.0, *start).stuck1 for start in zip(x, v, strict=True)])


def dyadic() -> vx.ImpactSystem:
    """A machine of exact binary numbers, so that a contact force can be exactly zero."""
    load = vx.Harmonic([0.5, 0.0], 0.5)
    stops = [vx.Stop(1, 0.125, "upper", 0.5), vx.Stop(0, -64.0, "lower", 0.5)]
    return vx.chain([1.0, 1.0], [0.125, 0.125], [1.0, 1.0], load, stops)


def test_a_mass_at_rest_on_its_stop_is_held_inside_the_region_and_on_its_entry_boundary_only():
    system, rng = dyadic(), np.random.default_rng(3)
    region = vx.sticking_region(system, held=0)
    x, v = rng.normal(size=(6, 1)), rng.normal(size=(6, 1))
    # On the boundary v = 1 - 8 x the force is exactly zero; its rate v - a / 8 has either sign.
    edge = rng.integers(-64, 64, (6, 1)) / 64
    x, v = np.concatenate([x, edge]), np.concatenate([v, 1 - 8 * edge])
    inside = np.asarray(region.contains(0.0, x, v))
    assert set(inside[:6]) == set(inside[6:]) == {True, False}
    np.testing.assert_array_equal(region.contact_force(0.0, x[6:], v[6:]), 0)
    np.testing.assert_array_equal(inside[6:], region.contact_force_rate(0.0, x[6:], v[6:])[:, 0] > 0)
    whole = np.concatenate([x, np.full_like(x, 0.125)], axis=1), np.concatenate([v, 0 * v], axis=1)
    np.testing.assert_array_equal(inside, held_at_once(system, *whole)[:, 0])


def test_where_force_and_rate_vanish_the_next_derivative_decides():
    # At phase 0 velocity and contact force are zero; then the load grows or falls like t^2.
    for amplitude, stays in ((-0.5, True), (0.5, False)):
        load = vx.Harmonic([amplitude], 1.0, mean=[-amplitude])
        system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0, "upper", 0.5)])
        region = vx.sticking_region(system, held=0)
        nobody = np.zeros(0)
        assert region.contact_force(0.0, nobody, nobody)[0] == 0
        assert region.contact_force_rate(0.0, nobody, nobody)[0] == 0
        assert bool(region.contains(0.0, nobody, nobody)) is stays


def test_points_are_taken_in_any_shape():
    region = vx.sticking_region(vx.models.wagg_bishop_a(0.2), held=0)
    x, v = np.linspace(0, 1, 5)[:, None], np.ones(1)
    force = region.contact_force(np.zeros((3, 1)), x, v)
    assert force.shape == (3, 5, 1)
    assert region.contains(np.zeros((3, 1)), x, v).shape == (3, 5)
    np.testing.assert_array_equal(force[1, 4], region.contact_force(0.0, x[4], v))


def test_the_boundary_is_differentiable_by_the_machine():
    def level(position):
        load = vx.Harmonic([0.5, 0.0], 0.2)
        system = vx.chain([1.0, 1.0], [0.1, 0.1], [1.0, 3.0], load, [vx.Stop(0, position, "lower", 0.7)])
        return vx.sticking_region(system, held=0).level(0.3)[0]

    # lam = -(f - K00 s + ...) for a lower stop, so c = f - K00 s with K00 = 1 + 3.
    np.testing.assert_allclose(jax.jit(jax.grad(level))(-0.3), -4.0, rtol=1e-15)


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ([], "Argument `held` is empty"),
        (4, "names stop 4, but the machine has 4 stops"),
        (-1, "names stop -1"),
        ([0, 2], "must name one stop of a mass, but stops .* are of masses"),
        ([0, 0], "must name one stop of a mass"),
    ],
)
def test_stops_that_hold_nothing_are_refused(held, message):
    with pytest.raises(ValueError, match=message):
        vx.sticking_region(four_masses(np.random.default_rng(7)), held)


def test_a_point_of_the_wrong_size_is_refused():
    region = vx.sticking_region(vx.models.wagg_bishop_a(0.2), held=0)
    with pytest.raises(
        ValueError, match=r"Argument `x` must have shape \(\.\.\., 1\), .* free masses \(1,\)"
    ):
        region.contact_force(0.0, [0.1, 0.2], [0.0])
    with pytest.raises(ValueError, match="Argument `v` must have shape"):
        region.contains(0.0, [0.1], 0.0)
