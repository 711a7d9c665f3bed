"""Loads by tables: their polynomials against SciPy, sums, paths, files, texts, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from outputs import show
from scipy.interpolate import CubicSpline

import vijax as vx
from vijax._system.load import LoadSum

# A few roundings of values of size one, and of derivatives relative to their size.
ROUNDING = 1e-13
STOP = [vx.Stop(0, 0.4, "upper", 0.7)]
TABLE = vx.Tabulated([0.5, 1.0, 2.5], [[0.0], [1.0], [-0.5]])
SQUARE = vx.Waveform([0.0, np.pi], [[1.0], [-1.0]], 0.8, "previous")


def machine(load, **parts) -> vx.ImpactSystem:
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, STOP, **parts)


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
@pytest.mark.parametrize("is_traced", [False, True])
def test_a_cubic_table_is_the_not_a_knot_spline_of_scipy(count: int, is_traced: bool):
    rng = np.random.default_rng(count)
    times, values = np.cumsum(rng.uniform(0.1, 1.0, count)), rng.normal(size=(count, 2))
    expected = CubicSpline(times, values, bc_type="not-a-knot").c[::-1]
    rows = lambda t, y: vx.Tabulated(t, y, "cubic").derivatives()  # noqa: E731
    found = np.asarray(jax.jit(rows)(times, values) if is_traced else rows(times, values))
    for k, factorial in enumerate((1, 1, 2, 6)):
        size = max(1.0, abs(expected[k]).max() * factorial)
        np.testing.assert_allclose(found[:, k], expected[k] * factorial, rtol=0, atol=ROUNDING * size)


@pytest.mark.parametrize("count", [2, 3, 4, 40])
def test_a_cubic_wave_form_is_the_periodic_spline_of_scipy(count: int):
    rng = np.random.default_rng(count)
    phases, values = np.sort(rng.uniform(0, 2 * np.pi, count)), rng.normal(size=(count, 2))
    whole = np.append(phases, phases[0] + 2 * np.pi), np.concatenate([values, values[:1]])
    expected = CubicSpline(*whole, bc_type="periodic").c[::-1]
    found = np.asarray(vx.Waveform(phases, values, 1.0, "cubic").derivatives())
    for k, factorial in enumerate((1, 1, 2, 6)):
        size = max(1.0, abs(expected[k]).max() * factorial)
        np.testing.assert_allclose(found[:, k], expected[k] * factorial, rtol=0, atol=10 * ROUNDING * size)


def test_loads_of_one_frequency_share_it_in_a_sum():
    both = SQUARE + vx.Harmonic([0.3], 0.8) + vx.Harmonic([0.0], 0.0, mean=[0.1])
    assert float(both.frequency) == 0.8
    assert both[0].frequency is None
    assert float(both.period) == pytest.approx(2 * np.pi / 0.8)
    assert len(both) == 3
    faster = vx.simulate(machine(SQUARE + vx.Harmonic([0.3], 0.8)), 0.0, 20.0)
    assert faster.result == vx.RESULTS.successful


def test_a_sum_of_harmonics_is_one_load_with_all_of_them():
    both = vx.Harmonic([0.3], 0.9, [0.4]) + vx.Harmonic([[0.1], [0.2]], 0.9, mean=[0.1])
    one = vx.Harmonic([[0.3 * np.cos(0.4) + 0.1], [0.2]], 0.9, mean=[0.1])
    sine = vx.Harmonic([0.3 * np.sin(0.4)], 0.9, [np.pi / 2])
    a, b = (vx.simulate(machine(load), 0.0, 30.0) for load in (both, one + sine))
    np.testing.assert_allclose(a.x1, b.x1, rtol=0, atol=ROUNDING)
    assert int(a.num_events) == int(b.num_events) > 0


def test_python_adds_lists_of_loads():
    total = sum([TABLE, TABLE, SQUARE])
    assert isinstance(total, LoadSum)
    assert len(total) == 3


def test_paths_name_the_numbers_of_each_load():
    names = [
        "forcing.frequency",
        "forcing[0].values[1][0]",
        "forcing[1].amplitude[0]",
    ]
    values = {names[0]: [0.8], names[1]: [-1.0, -0.5], names[2]: [0.2]}
    ds = vx.sweep(machine(SQUARE + vx.Harmonic([0.3], 0.8)), values, transient=3, record=2, progress=False)
    load = vx.Waveform([0.0, np.pi], [[1.0], [-0.5]], 0.8, "previous") + vx.Harmonic([0.2], 0.8)
    sol = vx.simulate(machine(load), 0.0, 5 * load.period)
    np.testing.assert_allclose(ds.x.values.ravel()[1], sol.x1, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("suffix", ["toml", "json"])
@pytest.mark.parametrize(
    "load", [TABLE, SQUARE, TABLE + SQUARE, SQUARE + vx.Harmonic([0.3], 0.8)], ids=lambda a: type(a).__name__
)
def test_files_return_every_bit(load, suffix: str, tmp_path):
    path, before = tmp_path / f"machine.{suffix}", machine(load)
    vx.save(before, path)
    after = vx.load(path)
    assert jax.tree.structure(after) == jax.tree.structure(before)
    for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(before), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_dataset_returns_a_machine_under_a_long_record(tmp_path):
    rng = np.random.default_rng(0)
    phases = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    wave = vx.Waveform(phases, rng.normal(size=(2000, 1)), 0.8)
    ds = vx.sweep(machine(wave), {"stops[0].position": [0.4]}, transient=1, record=1, progress=False)
    ds.to_netcdf(tmp_path / "sweep.nc")
    import xarray as xr

    with xr.open_dataset(tmp_path / "sweep.nc") as stored:
        np.testing.assert_array_equal(vx.system_of(stored).forcing.values, wave.values)


def test_texts_name_loads_and_their_sizes():
    text = show(machine(TABLE + vx.Harmonic([0.3], 0.8)))
    assert "Tabulated load, linear, 3 knots: times 0.5 to 2.5, largest 1" in text
    assert "amplitude 0.3, frequency 0.8" in text
    assert show(SQUARE).splitlines()[0] == "Waveform, previous, 2 knots"
    assert "frequency  0.8" in show(SQUARE + vx.Harmonic([0.3], 0.8))


def test_a_base_may_move_by_a_record():
    record = vx.Tabulated([0.0, 1.0, 2.0], [0.0, 3.0, 0.0])
    load = vx.base_excitation([1.0, 2.0], acceleration=record, mean=[0.1, 0.2])
    assert isinstance(load, LoadSum)
    record_of_base, weight = load.parts
    assert isinstance(record_of_base, vx.Tabulated)
    assert isinstance(weight, vx.Harmonic)
    np.testing.assert_array_equal(record_of_base.values, [[-0.0, -0.0], [-3.0, -6.0], [-0.0, -0.0]])
    np.testing.assert_array_equal(weight.mean, [0.1, 0.2])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: vx.Tabulated([0.0], [[1.0]]), "`times` must have two knots or more"),
        (lambda: vx.Tabulated([0.0, 0.0], [[1.0], [2.0]]), "knot 1 .0. does not lie behind knot 0"),
        (lambda: vx.Tabulated([0.0, np.nan], [[1.0], [2.0]]), "`times` must be finite"),
        (lambda: vx.Tabulated([0.0, 1.0], [[1.0, 2.0]]), r"`values` must have shape \(knots, n\)"),
        (lambda: vx.Tabulated([[0.0, 1.0]], [[1.0, 2.0]]), r"`times` must have shape \(knots,\)"),
        (
            lambda: vx.Tabulated([0.0, 1.0], [1.0, 2.0], "spline"),
            "`kind` must be one of 'linear', 'previous'",
        ),
        (lambda: vx.Waveform([0.0, 7.0], [1.0, 2.0], 1.0), r"`phases` must lie in \[0, 2 pi\)"),
        (lambda: vx.Waveform([0.0, 3.0], [1.0, 2.0], 0.0), "`frequency` must be positive"),
        (lambda: machine(vx.Tabulated([0.0, 1.0], [[1.0, 1.0]] * 2)), "`forcing.values` must end in"),
        (lambda: TABLE + vx.Harmonic([1.0, 0.0], 1.0), "must act on the same masses"),
        (lambda: vx.base_excitation([1.0], acceleration=3.0), "`acceleration` must be a `vx.Tabulated`"),
        (lambda: vx.base_excitation([1.0], 0.1, 1.0, acceleration=TABLE), "stands in place of `amplitude`"),
        (lambda: vx.base_excitation([1.0]), "The motion of the base is missing"),
        (
            lambda: vx.ImpactSystem(
                [1.0],
                [[0.1]],
                [[1.0]],
                TABLE,
                [vx.Stop(0, 0.4, "upper", 0.7, vx.Harmonic([0.1], 0.9))],
            ),
            r"`stops\[0\]` moves with a period",
        ),
    ],
)
def test_loads_that_make_no_sense_are_refused(make, sentence: str):
    with pytest.raises(ValueError, match=sentence):
        make()


OTHER = vx.Waveform([0.0, 3.0], [[1.0], [-1.0]], 0.9)
TWO = vx.Harmonic([0.1], 0.9) + vx.Harmonic([0.1], 0.8)


@pytest.mark.parametrize(
    ("load", "sentence"),
    [
        (TABLE, "does not repeat"),
        (SQUARE + OTHER, "different frequencies"),
        (TWO, "different frequencies"),
    ],
)
def test_tools_that_count_periods_refuse_loads_without_one(load, sentence: str):
    system = machine(load)
    sol = vx.simulate(system, 0.0, 30.0)
    for ask in (
        lambda: vx.sweep(system, {"stops[0].position": [0.4]}, progress=False),
        lambda: vx.stroboscopic_map(system, [0.0], [0.0]),
        lambda: vx.periodic_orbit(system, [0.0], [0.0]),
        lambda: vx.find_periodic_orbits(system, np.zeros((4, 2)), 1),
        lambda: vx.lyapunov_exponents(system),
        lambda: vx.attractors(system, 16),
    ):
        with pytest.raises(ValueError, match=sentence):
            ask()
    for judge in (vx.classify, vx.stroboscopic_section, vx.power_spectrum):
        with pytest.raises(ValueError, match="does not repeat"):
            judge(sol)


@pytest.mark.parametrize("second", [0.8, 0.9])
def test_traced_frequencies_may_differ(second: float):
    def end(w):
        load = vx.Waveform([0.0, 3.0], [[1.0], [-1.0]], w[0]) + vx.Harmonic([0.1], w[1])
        return vx.simulate(machine(load), 0.0, 5.0).x1

    w = jnp.array([0.8, second])
    np.testing.assert_allclose(jax.jit(end)(w), end(w), rtol=0, atol=1e-13)


def test_a_traced_frequency_that_two_loads_have_is_that_of_their_sum():
    def has_period(w):
        load = vx.Waveform([0.0, 3.0], [[1.0], [-1.0]], w) + vx.Harmonic([0.1], w)
        assert not load.why_not_periodic
        return load.period

    assert float(jax.jit(has_period)(jnp.asarray(0.8))) == pytest.approx(2 * np.pi / 0.8)
