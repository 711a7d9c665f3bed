"""A mass leaves a stop of zero restitution for a hop that vanishes: the time of its landing is a double root there."""

import numpy as np
import pytest

import vijax as vx
from vijax._branches.membership import KnownOrbits
from vijax._branches.starts import starting_orbits

FREQUENCY, BOUNDS = "forcing.frequency", (1.4387502167010644, 2.397917027835107)


# A random machine; its upper stop is elastic. With fewer digits rounding is another.
AMPLITUDE, PHASE, STIFFNESS, LOWER = (
    2.7982441837629484,
    2.5977659057621554,
    7.037653394647343,
    -0.3141757391383116,
)


def orbit_at(frequency):
    load = vx.Harmonic([AMPLITUDE], frequency, [PHASE])
    stops = [vx.Stop(0, 0.6732248340864113, "upper", 1.0), vx.Stop(0, LOWER, "lower", 0.0)]
    system = vx.ImpactSystem([1.3556479739508247], [[0.38939640022091176]], [[STIFFNESS]], load, stops)
    v0 = [2.0599903273138382]
    sol = vx.simulate(system, 0.0, 2000 * system.forcing.period, None, v0, throw=False, max_events=8)
    return vx.periodic_orbit(system, sol.x1, sol.v1)


@pytest.mark.slow
def test_branches_pass_a_vanishing_hop():
    """Steps reach it where the hop is a rounding error, and may pass it: starts differ by their rounding."""
    starts = [orbit_at(float(frequency)) for frequency in np.linspace(1.45, 2.39, 24)]
    branches = vx.continuation(starts, FREQUENCY, BOUNDS, progress=False)
    assert {branch.ends for branch in branches} == {("bounds", "bounds")}
    (value, *others), (kind,) = (
        list(dict.fromkeys(own))
        for own in zip(*((p.value, p.kind) for b in branches for p in b.bifurcations), strict=True)
    )
    assert kind == "force_zero"
    np.testing.assert_allclose(others, value, rtol=1e-12)
    # There the mass comes to rest on the stop with a force of zero.
    (point,) = branches[-1].bifurcations
    events = point.orbit.events
    last = np.flatnonzero((np.asarray(events.kind) == vx.IMPACT) & (np.asarray(events.stop) == 1))[-1]
    force = AMPLITUDE * np.cos(value * float(events.t[last]) + PHASE) - STIFFNESS * LOWER
    assert abs(force) < 1e-9
    # Where both states at the start of a cycle turn back, orbits lie farther from the points beside than these are apart.
    assert all(
        on == set(range(24))
        for on in KnownOrbits(starting_orbits(starts)).on([*range(24)], branches).values()
    )
