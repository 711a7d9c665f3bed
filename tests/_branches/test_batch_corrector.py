"""The corrector of many cycles at once has the results of the corrector of one."""

import jax
import numpy as np
import pytest

import vijax as vx
from vijax._branches.kernels import corrected_cycle, corrected_cycles
from vijax._branches.padding import padded, room_for
from vijax._branches.start_points import points_of
from vijax._branches.starts import families_of, starting_orbits

pytestmark = pytest.mark.slow

AMPLITUDE = "forcing.amplitude[0]"
STEP = 1e-2
# Sums in another order, and the inverses of Jacobians of a size of 10.
ROUNDING = 1e-12


def oscillator(amplitude):
    stop = vx.Stop(0, 1.0, "upper", 0.9)
    return vx.ImpactSystem([1.0], [[0.04]], [[1.0]], vx.Harmonic([amplitude], 0.84091), [stop])


def impacting():
    amplitudes = 0.36, 0.38, 0.4, 0.42
    found = [vx.periodic_orbit(oscillator(a), [0.43252758], [0.148], 2, max_events=32) for a in amplitudes]
    # One without impacts: lanes have different numbers of events.
    return [*found, vx.periodic_orbit(oscillator(0.2), [0.0], [0.0], 2, max_events=32)]


def sticking():
    def machine(amplitude):
        load = vx.Harmonic([amplitude], 0.2)
        return vx.ImpactSystem([1.0], [[0.4]], [[1.0]], load, [vx.Stop(0, 0.25, "upper", 0.0)])

    found = [vx.periodic_orbit(machine(a), [0.0], [0.0], max_events=32) for a in (0.4, 0.45)]
    assert all(np.any(np.asarray(orbit.events.kind) == vx.RELEASE) for orbit in found)
    return found


@pytest.mark.parametrize("make", [impacting, sticking])
def test_cycles_corrected_side_by_side_are_those_corrected_alone(make):
    starts = starting_orbits(make())
    families = families_of(starts, AMPLITUDE, 0.1, 0.5)
    rows = []
    for family, point in zip(families, points_of(starts, families), strict=True):
        room = room_for(1)
        sequence, place, tangent = padded(point.sequence, (point.place, point.tangent), room)
        target = np.asarray(place.along(tangent) + STEP)
        rows.append((family, sequence, place.moved(tangent, STEP), tangent, target))
    given = jax.tree.map(lambda *a: np.stack(a), *rows)
    together = jax.jit(corrected_cycles)(*given)
    alone = jax.jit(jax.vmap(corrected_cycle))(*given)
    assert bool(alone.found.is_converged.all())
    together, alone = (
        found._replace(found=found.found._replace(first=0, num_steps=0)) for found in (together, alone)
    )
    for one, other in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=ROUNDING)
