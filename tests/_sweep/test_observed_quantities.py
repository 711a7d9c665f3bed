"""Extremes, root mean squares and contact forces of sweeps: against closed forms, and against single runs searched by brute force."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr

import vijax as vx

pytestmark = pytest.mark.thorough

FREQUENCY = "forcing.frequency"
OF_MASSES = (
    *("max_position", "min_position", "peak_to_peak", "max_velocity", "min_velocity"),
    *("rms_position", "rms_velocity"),
    *("max_acceleration", "min_acceleration", "rms_acceleration", "max_absolute_acceleration"),
)
ALL = [*OF_MASSES, "max_force"]
TRANSIENT, RECORD = 3, 4
# Relative: some roundings of sums over a dozen steps.
EXACT = 1e-14
# Some hundred roundings, with the amplification of these motions.
ROUNDING = 1e-11
# Of a force: tolerances of the flow, 1e-10, and the amplification of the motion.
SOLVED = 1e-7
# Of the amplitude of Den Hartog, after the transient and through some hundred stops of the motion.
SETTLED = 1e-11
# Times in each flight, and in each zoom on the best of them, whose neighbours are 1e-7 of a flight apart in the end.
SAMPLES, ZOOMS = 400, 2
# Gauss-Legendre nodes of a flight for its squares.
NODES = 24


def sweep(system: vx.ImpactSystem, values: dict, quantities: list[str] = ALL, **options) -> xr.Dataset:
    options = {"transient": TRANSIENT, "record": RECORD, "progress": False} | options
    return vx.sweep(system, values, quantities=quantities, **options)


def test_a_harmonic_response_has_its_amplitude_as_extremes_and_its_root_half_as_mean():
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 1.0, mean=[0.25]))
    w = np.linspace(0.5, 1.5, 11)
    ds = sweep(system, {FREQUENCY: w}, transient=120)
    a = 1 / np.sqrt((1 - w**2) ** 2 + (0.1 * w) ** 2)
    rms = np.sqrt(0.25**2 + a**2 / 2)
    b = w * w * a
    known = (0.25 + a, 0.25 - a, 2 * a, w * a, -w * a, rms, w * a / np.sqrt(2), b, -b, b / np.sqrt(2), b)
    for name, expected in zip(OF_MASSES, known, strict=True):
        assert ds[name].dims == (FREQUENCY, "mass")
        # The transient has decayed by exp(-0.05 * 120 * 2 pi / 1.5), 1e-11.
        np.testing.assert_allclose(ds[name][:, 0], expected, rtol=1e-9, err_msg=name)
    assert ds.max_force.dims == (FREQUENCY, "stop")
    settled = sweep(system, {FREQUENCY: w}, transient=300)
    for name, expected in zip(OF_MASSES, known, strict=True):
        np.testing.assert_allclose(settled[name][:, 0], expected, rtol=EXACT, err_msg=name)


def test_absolute_accelerations_are_those_of_the_transmission_of_the_base():
    """Den Hartog: the mass moves in space by a sqrt((k^2 + (c W)^2) / ((k - m W^2)^2 + (c W)^2)) of the base's a."""
    w, a, c, k, m = np.linspace(0.5, 1.5, 5), 0.3, 0.2, 1.0, 2.0
    names, values = ["max_acceleration", "max_absolute_acceleration"], {"forcing.frequency": w}
    gain = np.sqrt((k**2 + (c * w) ** 2) / ((k - m * w**2) ** 2 + (c * w) ** 2))
    relative = m * w**2 / np.sqrt((k - m * w**2) ** 2 + (c * w) ** 2)
    load = vx.base_excitation([m], amplitude=a, frequency=1.0, mean=[0.7])
    both = load + vx.Harmonic([0.0], 0.0, mean=[0.1])
    for one in (load, both):
        system = vx.ImpactSystem([m], [[c]], [[k]], one)
        ds = sweep(system, values, names, transient=200)
        # The sweep keeps the acceleration of the base, a.
        np.testing.assert_allclose(ds.max_absolute_acceleration[:, 0], a * gain, rtol=1e-10)
        np.testing.assert_allclose(ds.max_acceleration[:, 0], a * relative, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mass", [pytest.param([1.0, 2.0], marks=pytest.mark.slow), np.diag([1.0, 2.0])], ids=["masses", "matrix"]
)
def test_absolute_accelerations_on_a_shaken_base_are_spring_and_damper_forces_by_the_mass(mass):
    """Of a record, a wave form and a load on the mass: x'' + y'' = (f - c v - k x) / m, for a full mass matrix too."""
    times = np.linspace(0.0, 9.0, 40)
    record = vx.Tabulated(times, np.cumsum(np.random.default_rng(2).normal(size=40)) * 0.3)
    wave = vx.Waveform([0.0, 2.0], [0.4, -0.4], 1.3, kind="previous")
    pull = vx.Harmonic([0.2, 0.0], 0.9)
    base = sum(vx.base_excitation([1.0, 2.0], acceleration=one) for one in (record, wave))
    stops = [vx.Stop(0, 0.3, "upper", 0.7)]
    c, k = 0.1 * np.eye(2), np.array([[2.0, -1.0], [-1.0, 1.5]])
    system = vx.ImpactSystem(mass, c, k, base + pull, stops)
    values = {"stops[0].position": [0.3]}
    ds = vx.sweep(system, values, duration=9.0, quantities=["max_absolute_acceleration"], progress=False)
    sol = vx.simulate(system, 0.0, 9.0)
    t = np.unique(np.concatenate([np.linspace(0.0, 9.0, 40_001), np.nextafter(times[1:], 0.0)]))
    x, v = map(np.asarray, sol.evaluate(t))
    forces = np.outer(np.cos(0.9 * t), [0.2, 0.0]) - v @ c - x @ k
    largest = np.abs(forces / [1.0, 2.0]).max(axis=0)
    assert int(sol.num_events) > 1
    assert (ds.max_absolute_acceleration[0] >= largest - 1e-13).all()
    np.testing.assert_allclose(ds.max_absolute_acceleration[0], largest, rtol=3e-4)


@pytest.mark.slow
@pytest.mark.parametrize("of_record", [False, True])
def test_absolute_accelerations_with_jenkins_elements_that_never_slip_are_those_with_springs(of_record):
    names, k, more = (
        ["max_absolute_acceleration", "max_acceleration"],
        np.diag([2.0, 1.0]),
        np.full((2, 2), 0.5),
    )
    pulse = vx.Tabulated([0.0, 1.0, 3.0], [0.0, 1.0, -1.0])
    load = vx.base_excitation([1.0, 2.0], 0.3, 0.9)
    load += vx.base_excitation([1.0, 2.0], acceleration=pulse) if of_record else vx.Harmonic([0.1, 0.0], 0.9)
    joint = vx.Jenkins({0: 1.0, 1: 1.0}, 0.5, 100.0)
    machines = (
        vx.ImpactSystem([1.0, 2.0], 0.1 * np.eye(2), k, load, hysteresis=[joint]),
        vx.ImpactSystem([1.0, 2.0], 0.1 * np.eye(2), k + more, load),
    )
    values = {"mass[0]": [1.0, 1.1]}
    found, known = (vx.sweep(one, values, duration=5.0, quantities=names, progress=False) for one in machines)
    for name in names:
        np.testing.assert_allclose(found[name][:, :2], known[name], rtol=1e-12, err_msg=name)


def test_an_elastic_ball_has_the_extremes_and_means_of_its_parabolas():
    """One flight a period: height h, speeds up to u = g T / 2; the squares of x and v have the means 8 h^2 / 15, u^2 / 3."""
    height, gravity = 0.8, 9.81
    u = np.sqrt(2 * gravity * height)
    system = vx.models.bouncing_ball(1.0, gravity=gravity, frequency=2 * np.pi * gravity / (2 * u))
    ds = sweep(system, {"x0[0]": [height]}, transient=0, record=3)
    known = (
        height,
        0.0,
        height,
        u,
        -u,
        height * np.sqrt(8 / 15),
        u / np.sqrt(3),
        *[-gravity] * 2,
        *[gravity] * 2,
    )
    found = [float(ds[name][0, 0]) for name in OF_MASSES]
    np.testing.assert_allclose(found, known, rtol=EXACT, atol=EXACT)
    assert float(ds.max_force[0, 0]) == 0


def test_a_ball_at_rest_presses_with_its_weight():
    system = vx.models.bouncing_ball(0.5, gravity=9.81, mass=2.0)
    ds = sweep(system, {"x0[0]": [0.0, 1.0]})
    np.testing.assert_allclose(ds.max_force[:, 0], 2.0 * 9.81, rtol=EXACT)
    np.testing.assert_array_equal(ds.rms_velocity, 0)


@pytest.mark.slow
def test_friction_leaves_the_amplitude_of_den_hartog():
    """X^2 = (A V)^2 - U^2, for motions without sticks."""
    system = vx.models.friction_oscillator(0.8, 4.0, damping_ratio=0.0)
    w, force = 0.8, 4.0
    v, u = 1 / (1 - w * w), np.sin(np.pi / w) / (w * (1 + np.cos(np.pi / w)))
    amplitude = np.sqrt((force * v) ** 2 - u**2)
    assert amplitude == pytest.approx(10.69344999245056, rel=EXACT)
    ds = sweep(system, {"forcing.amplitude[0]": [force]}, transient=2000)
    assert float(ds.max_position[0, 0]) == pytest.approx(amplitude, rel=SETTLED)
    assert float(ds.min_position[0, 0]) == pytest.approx(-amplitude, rel=SETTLED)


def shaken() -> vx.ImpactSystem:
    """A mass between walls of which one moves."""
    moving = vx.Harmonic([0.1], 1.3)
    stops = [vx.Stop(0, -0.4, "lower", 0.8, motion=moving), vx.Stop(0, 0.3, "upper", 0.6)]
    return vx.ImpactSystem([2.0], [[0.1]], [[1.0]], vx.Harmonic([2.0], 1.3), stops)


def duffing() -> vx.ImpactSystem:
    stops = [vx.Stop(0, 0.9, "upper", 0.7)]
    load = vx.Harmonic([1.0], 1.3)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, stops, force=vx.models.CubicSpring(1.0))


MACHINES = {
    "two masses that stick": (vx.models.wagg_bishop_b(0.2), ROUNDING),
    "a moving stop": (shaken(), ROUNDING),
    "a compliant stop": (vx.models.soft_impact_oscillator(0.8), ROUNDING),
    "a force": (duffing(), SOLVED),
}


class Run:
    """A single run, searched by brute force in every flight of its recorded periods."""

    def __init__(self, system: vx.ImpactSystem):
        self.first, self.last = (k * float(system.forcing.period) for k in (TRANSIENT, TRANSIENT + RECORD))
        self.sol = vx.simulate(system, 0.0, self.last, max_events=2000)
        times = self.sol.events.to_dataframe().t.to_numpy()
        inside = times[(times > self.first) & (times < self.last)]
        ends = np.unique([self.first, *inside, self.last])
        self.flights = [(a, np.nextafter(b, a)) for a, b in pairwise(ends) if b - a > 1e-12]

    def at(self, times: np.ndarray) -> dict[str, np.ndarray]:
        x, v = map(np.asarray, self.sol.evaluate(times))
        forces, accelerations = (
            np.asarray(f(times)) for f in (self.sol.contact_force, self.sol.acceleration)
        )
        return {"position": x, "velocity": v, "force": forces, "acceleration": accelerations}

    def largest(self, signal: str, sign: int) -> np.ndarray:
        grid = np.concatenate([np.linspace(a, b, SAMPLES) for a, b in self.flights])
        values = sign * self.at(grid)[signal]
        best = values.max(axis=0)
        for j, k in enumerate(values.argmax(axis=0)):
            a, b = self.flights[k // SAMPLES]
            t, width = grid[k], (b - a) / SAMPLES
            for _ in range(ZOOMS):
                near = np.linspace(max(t - width, a), min(t + width, b), SAMPLES)
                found = sign * self.at(near)[signal][:, j]
                t, width = near[found.argmax()], 2 * width / SAMPLES
                best[j] = max(best[j], found.max())
        return sign * best

    def rms(self, signal: str) -> np.ndarray:
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        total = 0.0
        for a, b in self.flights:
            parts = np.linspace(a, b, 5)
            for p, q in pairwise(parts):
                values = self.at((p + q) / 2 + nodes * (q - p) / 2)[signal]
                total += (q - p) / 2 * (weights @ values**2)
        return np.sqrt(total / (self.last - self.first))


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_quantities_are_those_of_single_runs_searched_by_brute_force(name):
    system, tolerance = MACHINES[name]
    ds = sweep(system, {"mass[0]": [float(system.mass[0])]})
    run = Run(system)
    low, high = run.largest("position", -1), run.largest("position", 1)
    known = {
        "max_position": high,
        "min_position": low,
        "peak_to_peak": high - low,
        "max_velocity": run.largest("velocity", 1),
        "min_velocity": run.largest("velocity", -1),
        "rms_position": run.rms("position"),
        "rms_velocity": run.rms("velocity"),
        "max_acceleration": run.largest("acceleration", 1),
        "min_acceleration": run.largest("acceleration", -1),
        "rms_acceleration": run.rms("acceleration"),
        "max_force": run.largest("force", 1),
    }
    if not system.forcing.from_base:
        size = np.maximum(known["max_acceleration"], -known["min_acceleration"])
        np.testing.assert_allclose(ds.max_absolute_acceleration[0], size, rtol=0, atol=tolerance)
    for one, expected in known.items():
        np.testing.assert_allclose(ds[one][0], expected, rtol=0, atol=tolerance, err_msg=one)
    if name in ("two masses that stick", "a compliant stop"):
        assert (known["max_force"] > 0.1).all()


@pytest.mark.slow
def test_motions_are_the_same_whether_they_are_observed_or_not_and_stores_keep_what_is_observed(tmp_path):
    system, values = vx.models.wagg_bishop_b(0.2), {FREQUENCY: np.linspace(0.2, 0.4, 6)}
    plain, observed = (sweep(system, values, names, carry="both") for names in ([], ["max_position"]))
    # Another program: it differs by rounding.
    xr.testing.assert_allclose(observed.drop_vars("max_position"), plain, rtol=0, atol=ROUNDING)
    kept = sweep(system, values, ["max_position"], carry="both", store=tmp_path / "store")
    again = sweep(system, values, ["max_position"], carry="both", store=tmp_path / "store")
    xr.testing.assert_equal(kept, observed)
    xr.testing.assert_equal(again, observed)
    with pytest.raises(ValueError, match="observed"):
        sweep(system, values, ["min_position"], carry="both", store=tmp_path / "store")


def test_a_motion_that_did_not_reach_its_end_has_no_extremes():
    with pytest.warns(UserWarning, match="max_steps"):
        ds = sweep(vx.models.wagg_bishop_a(0.8), {FREQUENCY: [0.8]}, max_steps=45)
    for name in ALL:
        assert np.isnan(ds[name]).all()
