"""Functions that need 64-bit numbers reject others in one sentence with the line that turns them on."""

import re
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from documents import ROOT

import vijax as vx
from vijax.studio.explorer.motion import motion_from
from vijax.studio.explorer.pictures import words_of_multipliers

# The warnings about 32-bit numbers, and about machines made of them, are tested elsewhere.
pytestmark = [
    pytest.mark.filterwarnings("ignore:vijax works in float32"),
    pytest.mark.filterwarnings("ignore:A machine, or a part of it, was built"),
]
LINE = 'jax.config.update("jax_enable_x64", True)'
FREQUENCY, POSITION = "forcing.frequency", "stops[0].position"
STARTS = {"x0[0]": [0.0, 0.1], "v0[0]": [0.0, 0.1]}
PLANE = {FREQUENCY: [0.7, 0.8], "forcing.amplitude[0]": [0.2, 0.3]}


def made_in(bits: int) -> vx.ImpactSystem:
    """A machine of numbers with that many bits."""
    with jax.enable_x64(bits == 64):
        return vx.models.impact_oscillator(2.4, restitution=0.4, damping_ratio=0.1)


@cache
def orbit_in(bits: int) -> vx.PeriodicOrbit:
    """An orbit of numbers with that many bits."""
    with jax.enable_x64(True):
        orbit = vx.periodic_orbit(made_in(64), [-0.1], [0.1])
    is_wide = lambda a: jnp.issubdtype(a.dtype, jnp.floating)  # noqa: E731
    return orbit if bits == 64 else jax.tree.map(lambda a: a.astype("float32") if is_wide(a) else a, orbit)


def bits_of(system: vx.ImpactSystem) -> int:
    """Bits of the numbers of a machine."""
    return 8 * system.mass.dtype.itemsize


def point_of(system: vx.ImpactSystem) -> vx.Bifurcation:
    """Stand-in for a fold, in the precision of a machine."""
    x0 = np.zeros((1, 1), system.mass.dtype)
    return vx.Bifurcation(vx.Branch(xr.Dataset({"x0": (("point", "mass"), x0)}), system), 0)


def states_of(system: vx.ImpactSystem, *names: str) -> xr.Dataset:
    """Stand-in for a sweep, in the precision of a machine."""
    return xr.Dataset({name: ((FREQUENCY, "mass"), np.zeros((1, 1), system.mass.dtype)) for name in names})


NEEDS = {
    "periodic_orbit": lambda s: vx.periodic_orbit(s, [-0.1], [0.1]),
    "find_periodic_orbits": lambda s: vx.find_periodic_orbits(s, [[-0.1, 0.1]], 1),
    "periodic_orbits": lambda s: vx.periodic_orbits(states_of(s, "x")),
    "continuation": lambda s: vx.continuation(orbit_in(bits_of(s)), FREQUENCY, (2.3, 2.5)),
    "branches": lambda s: vx.branches(states_of(s, "x0", "converged")),
    "switch_branch": lambda s: vx.switch_branch(point_of(s)),
    "bifurcation_curve": lambda s: vx.bifurcation_curve(point_of(s), POSITION, {}),
    "bifurcation_value": lambda s: vx.bifurcation_value(point_of(s), s),
    "attractors": lambda s: vx.attractors(s, 10),
    "basins": lambda s: vx.basins(s, STARTS),
    "follow_attractors": lambda s: vx.follow_attractors(s, FREQUENCY, [2.3, 2.4]),
    "chart` with `multipliers` or `starts": lambda s: vx.chart(s, PLANE, multipliers=True),
}


@pytest.mark.parametrize("on", [False, True], ids=["off", "turned on afterwards"])
@pytest.mark.parametrize("name", NEEDS)
def test_machines_of_single_precision_are_refused_with_the_line_to_add(name, on):
    with jax.enable_x64(on), pytest.raises(ValueError, match=re.escape(LINE)) as refused:
        NEEDS[name](made_in(32))
    assert str(refused.value).startswith(f"`{name}` needs 64-bit numbers")
    assert str(refused.value).count(". ") == 0, "it is one sentence"


@pytest.mark.parametrize("name", NEEDS)
def test_machines_of_64_bits_are_refused_where_these_are_off(name):
    with jax.enable_x64(False), pytest.raises(ValueError, match=re.escape(LINE)):
        NEEDS[name](made_in(64))


def test_it_is_also_refused_under_jit():
    system = made_in(64)
    with jax.enable_x64(False), pytest.raises(ValueError, match=re.escape(LINE)):
        jax.jit(lambda x: vx.periodic_orbit(system, x, [0.1]).x0)(np.array([-0.1], "float32"))


def test_a_run_warns_of_nothing_but_its_lost_digits():
    with jax.enable_x64(False):
        sol = vx.simulate(made_in(32), 0.0, 3.0, [-0.1], [0.1])
    assert sol.x1.dtype == np.float32


@pytest.mark.slow
def test_a_chart_without_orbits_needs_no_64_bits():
    with jax.enable_x64(False):
        ds = vx.chart(made_in(32), PLANE, transient=5, record=4, stride=1, progress=False)
    assert ds.is_computed.all()


@pytest.mark.slow
def test_the_explorer_shows_a_motion_of_single_precision_without_multipliers():
    with jax.enable_x64(False):
        orbit = orbit_in(32)
        motion = motion_from(made_in(32), 8, np.asarray(orbit.x0), np.asarray(orbit.v0))
        assert words_of_multipliers(motion) == "none: they need 64-bit numbers"
    assert motion.num_periods == 1


def examples() -> list[str]:
    """Code of all docstrings."""
    found = []
    for file in sorted((ROOT / "vijax").rglob("*.py")):
        found += re.findall(r"^ *```python\n(.*?)\n *```", file.read_text(), re.M | re.S)
    return found


def test_every_example_that_needs_the_line_has_it_before_anything_else():
    names = "|".join(name for name in NEEDS if name.isidentifier())
    needy = [code for code in examples() if re.search(rf"vx\.({names})\(|starts=|multipliers=True", code)]
    assert len(needy) > len(NEEDS)
    told = [[line.strip() for line in code.splitlines()] for code in needy]
    assert [lines for lines in told if not (lines[0].startswith("import jax") and lines[1] == LINE)] == []
