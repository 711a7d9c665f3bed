"""Results do not depend on our own primitives and compiler options."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._jax import xla

# The same operations in the same order, up to fusion by the compiler.
ROUNDING = 1e-14
# Difference at the end of a periodic motion, whose rounding errors grew over the 120 periods before.
SETTLED = 1e-8

SWEEP = """
import pickle, sys
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import vijax as vx
frequencies = np.linspace(0.1, 2.5, 481)
ds = vx.sweep(vx.models.wagg_bishop_b(0.5), {"forcing.frequency": frequencies}, progress=False)
with open(sys.argv[1], "wb") as file:
    pickle.dump(ds, file)
"""


class Growth(xla.AbstractTask):
    """Growth by a factor until 10 is passed."""

    factor: jax.Array

    def is_live(self, carry):
        return carry[0] < 10

    def step(self, carry):
        x, steps = carry
        live = self.is_live(carry)
        return jnp.where(live, x * self.factor, x), steps + live


def grown(factor):
    def by(factor):
        return xla.while_any(Growth(factor), (jnp.ones(()), jnp.zeros((), int)))

    x, _ = xla.differentiable(by, factor)
    return xla.compute_once(jnp.sin, x)


@pytest.mark.parametrize("plain", [False, True])
def test_values_and_derivatives_of_a_loop_are_those_of_its_steps(plain, monkeypatch):
    monkeypatch.setattr(xla, "PLAIN", plain)
    # 1.5 passes 10 after 6 steps, 2 after 4.
    factors, steps = jnp.array([1.5, 2.0]), np.array([6, 4])
    expected = np.cos(factors**steps) * steps * factors ** (steps - 1)
    np.testing.assert_allclose(jax.vmap(grown)(factors), np.sin(factors**steps), rtol=ROUNDING)
    for derivative in (jax.jacfwd, jax.grad):
        np.testing.assert_allclose(jax.vmap(derivative(grown))(factors), expected, rtol=100 * ROUNDING)


def swept(folder: Path, plain: str) -> tuple[xr.Dataset, np.ndarray]:
    """Sweep in a separate process, and the points whose motion repeats."""
    file = folder / f"plain {plain}"
    subprocess.run(
        [sys.executable, "-c", SWEEP, str(file)], check=True, env={**os.environ, "VIJAX_PLAIN": plain}
    )
    ds = pickle.loads(file.read_bytes())
    motion = vx.classify(ds).motion
    names = motion.attrs["flag_meanings"].split()
    return ds, np.isin(motion, [names.index(name) for name in ("non_impacting", "periodic", "chattering")])


def change_of(section: np.ndarray) -> np.ndarray:
    """Change of a motion in its last cycle, for any period, (points, 1)."""
    steps = np.abs(section[:, -1:] - section[:, :-1])
    return steps.max(axis=2).min(axis=1, keepdims=True)


@pytest.mark.slow
@pytest.mark.thorough
def test_point_by_point_a_sweep_is_the_same_but_where_motions_are_chaotic(tmp_path):
    (ours, repeats), (plain, repeats_as_well) = swept(tmp_path, "0"), swept(tmp_path, "1")
    both = repeats & repeats_as_well
    assert both.mean() > 0.8
    assert (ours.num_impacts.values == plain.num_impacts.values)[both].all()
    assert (ours.num_sticks.values == plain.num_sticks.values)[both].all()
    for name in ("x", "v"):
        # A motion that still converges is within a few changes per cycle of its cycle.
        change = np.maximum(*(change_of(ds[f"section_{name}"].values) for ds in (ours, plain)))
        differs = np.abs(ours[name].values - plain[name].values)
        assert (differs <= SETTLED + 100 * change)[both].all()
    # A chaotic transient may have ended on the coexisting periodic motion in only one of them.
    assert (repeats != repeats_as_well).mean() < 0.02


@pytest.mark.slow
def test_derivatives_of_a_run_do_not_depend_on_our_primitives(monkeypatch):
    def end(frequency):
        system = vx.models.impact_oscillator(frequency, damping_ratio=0.1)
        return vx.simulate(system, 0.0, 12.0, [-0.1], [0.2], max_events=256).x1[0]

    own = jax.grad(end)(0.9)
    monkeypatch.setattr(xla, "PLAIN", True)
    assert float(jax.grad(end)(0.9)) == pytest.approx(float(own), rel=1e-10)
    assert float(jax.jit(jax.jacfwd(end))(0.9)) == pytest.approx(float(own), rel=1e-10)
