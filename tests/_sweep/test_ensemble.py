"""Uncertain machines: against closed forms, single runs, and quadrature."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

import vijax as vx

G, RESTITUTION = 9.81, "stops[*].restitution"
# Some hundred roundings of motions of the size of 1.
ROUNDING = 1e-11
# Error of a mean of 256 samples of a smooth function, relative to its spread: that of random samples is 0.06.
SOBOL = 2e-3
OPTIONS = {"transient": 0, "record": 1, "progress": False}
BALL = vx.models.bouncing_ball(0.5)


def chatter_end(r, height=1.0, gravity=G):
    """Time at which a ball dropped from a height lies still."""
    speed = np.sqrt(2 * gravity * height)
    return speed / gravity + 2 * r * speed / (gravity * (1 - r))


def measured_end(machine: vx.ImpactSystem):
    log = vx.simulate(machine, 0.0, 6.0, [1.0], max_events=64).events
    return log.t[jnp.argmax(log.kind == vx.STICK)]


def test_every_sample_has_the_exact_time_of_its_chatter():
    known = {"r": (RESTITUTION, scipy.stats.uniform(0.4, 0.2)), "h": ("x0[0]", scipy.stats.uniform(0.5, 1.0))}
    ds = vx.ensemble(BALL, known, samples=100, **OPTIONS)
    assert ds.sizes["sample"] == 100
    assert ds.r.attrs["path"] == RESTITUTION
    end = ds.forcing_period - ds.held_time[:, 0, 0]
    np.testing.assert_allclose(end, chatter_end(ds.r, ds.h), rtol=ROUNDING)
    np.testing.assert_array_equal(ds.x0[:, 0], ds.h)
    assert float(vx.system_of(ds.isel(sample=7)).stops[0].restitution) == float(ds.r[7])
    again = vx.ensemble(BALL, known, samples=100, **OPTIONS)
    np.testing.assert_array_equal(again.r, ds.r)
    assert not np.isin(vx.ensemble(BALL, known, samples=100, seed=1, **OPTIONS).r, ds.r).any()


def test_the_mean_and_spread_of_an_amplitude_are_those_of_quadrature():
    stop = [vx.Stop(0, -10.0, "lower", 0.5)]
    linear = vx.ImpactSystem([1.0], [[1.0]], [[3.0]], vx.Harmonic([1.0], 1.0), stop)
    known = {
        "stiffness[0][0]": scipy.stats.uniform(2.5, 1.0),
        "damping[0][0]": scipy.stats.norm(1.0, 0.05),
        "forcing.frequency": scipy.stats.uniform(0.9, 0.2),
    }

    def response(k, c, w):
        return 1 / (k - w**2 + 1j * c * w)

    ds = vx.ensemble(linear, known, **OPTIONS | {"transient": 20, "record": 2}, quantities=["mean_velocity"])
    found = ds.section_x[:, 0, 0] - 1j * ds.section_v[:, 0, 0] / ds["forcing.frequency"]
    exact = response(*(ds[path] for path in known))
    np.testing.assert_allclose(found, exact, atol=ROUNDING)
    assert ds.mean_velocity.dims == ("sample", "mass")
    assert vx.classify(ds).motion.dims == ("sample",)

    nodes, legendre = np.polynomial.legendre.leggauss(20)
    normal, hermite = np.polynomial.hermite_e.hermegauss(20)
    grid = np.meshgrid(3.0 + 0.5 * nodes, 1.0 + 0.05 * normal, 1.0 + 0.1 * nodes, indexing="ij")
    weights = np.einsum("i,j,k->ijk", legendre, hermite, legendre) / (4 * np.sqrt(2 * np.pi))
    mean, square = (float((np.abs(response(*grid)) ** p * weights).sum()) for p in (1, 2))
    amplitude, std = np.abs(found), np.sqrt(square - mean**2)
    assert float(amplitude.mean()) == pytest.approx(mean, abs=SOBOL * std)
    assert float(amplitude.std()) == pytest.approx(std, rel=10 * SOBOL)


def test_correlated_normal_quantities_have_their_correlation():
    known = {RESTITUTION: scipy.stats.norm(0.5, 0.02), "x0[0]": scipy.stats.norm(1.0, 0.1)}
    ds = vx.ensemble(BALL, known, correlation=[[1.0, -0.8], [-0.8, 1.0]], **OPTIONS)
    found = np.corrcoef(ds[RESTITUTION], ds["x0[0]"])[0, 1]
    assert found == pytest.approx(-0.8, abs=0.01)
    assert float(ds[RESTITUTION].std()) == pytest.approx(0.02, rel=0.01)


@pytest.mark.thorough  # reverse derivatives of a trajectory
@pytest.mark.slow
def test_derivatives_tell_the_spread_that_samples_show_where_it_is_small():
    known = {
        "r": (RESTITUTION, scipy.stats.norm(0.5, 0.002)),
        "load": ("forcing.mean[0]", scipy.stats.norm(-G, 0.02)),
    }
    found = vx.sensitivity(measured_end, BALL, known)
    assert found.quantity.values.tolist() == ["r", "load"]
    assert float(found.value) == pytest.approx(chatter_end(0.5), rel=ROUNDING)
    by_r = 2 * np.sqrt(2 / G) / 0.5**2
    by_load = chatter_end(0.5) / (2 * G)
    np.testing.assert_allclose(found.derivative, [by_r, by_load], rtol=1e-8)
    np.testing.assert_allclose(found.contribution, [0.002 * by_r, 0.02 * by_load], rtol=1e-8)
    assert float(found["std"]) == pytest.approx(np.hypot(0.002 * by_r, 0.02 * by_load), rel=1e-8)
    ds = vx.ensemble(BALL, known, x0=[1.0], **OPTIONS)
    end = ds.forcing_period - ds.held_time[:, 0, 0]
    # What is left out is of the order of the spread of r relative to 1 - r.
    assert float(end.std()) == pytest.approx(float(found["std"]), rel=0.01)
    assert float(end.mean()) == pytest.approx(float(found.value), abs=0.01 * float(found["std"]))
    one = vx.sensitivity(measured_end, BALL, known, correlation=[[1.0, -0.5], [-0.5, 1.0]])
    a, b = 0.002 * by_r, 0.02 * by_load
    assert float(one["std"]) == pytest.approx(np.sqrt(a**2 + b**2 - a * b), rel=1e-8)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "must give the distribution"),
        ({RESTITUTION: 0.5}, "must have `ppf`"),
        ({"damping": scipy.stats.norm(0, 1)}, "names an array"),
        ({"stops[0].restitutoin": scipy.stats.norm(0, 1)}, "names nothing"),
        ({RESTITUTION: scipy.stats.norm(0.9, 0.2)}, "restitution"),
        ({"x": (RESTITUTION, scipy.stats.norm(0.5, 0.02))}, "short name"),
    ],
)
def test_what_is_no_distribution_of_a_number_is_refused(given, said):
    with pytest.raises(ValueError, match=said):
        vx.ensemble(BALL, given, **OPTIONS)


def test_other_wrong_arguments_are_refused():
    known = {RESTITUTION: scipy.stats.norm(0.5, 0.02)}
    with pytest.raises(ValueError, match="`correlation`"):
        vx.ensemble(BALL, known, correlation=[[2.0]], **OPTIONS)
    with pytest.raises(ValueError, match="single number"):
        vx.sensitivity(lambda machine: machine.mass, BALL, known)
    with pytest.raises(ValueError, match="finite mean"):
        vx.sensitivity(measured_end, BALL, {RESTITUTION: scipy.stats.cauchy(0.5, 0.1)})


@pytest.mark.slow
def test_the_starts_of_samples_have_the_stretches_of_jenkins_elements():
    def sliding(slider):
        load = vx.Harmonic([0.5], 2.2)
        joint = vx.Jenkins(0, 0.3, 0.05, slider=slider)
        return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, hysteresis=[joint])

    path = "hysteresis[0].slider"
    known = {path: scipy.stats.uniform(-0.1, 0.2)}
    ds = vx.ensemble(sliding(0.0), known, samples=4, duration=10.0, progress=False)
    np.testing.assert_allclose(ds.v0.values[:, 1], -ds[path].values, rtol=0, atol=1e-15)
    for slider, x in zip(ds[path].values, ds.x.values, strict=True):
        sol = vx.simulate(sliding(float(slider)), 0.0, 10.0)
        np.testing.assert_allclose(x[0], sol.x1[0], rtol=0, atol=1e-12)
