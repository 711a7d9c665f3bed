"""Orbits are recognised on branches."""

import pytest

import vijax as vx
from vijax._branches import membership
from vijax._branches.kinds import EndKind
from vijax._branches.membership import KnownOrbits
from vijax._branches.point import End
from vijax._branches.starts import starting_orbits

pytestmark = pytest.mark.thorough

FREQUENCY = "forcing.frequency"


@pytest.fixture(scope="module")
def followed():
    """An orbit of one impact a period, and its branch."""
    system = vx.models.impact_oscillator(2.5, damping_ratio=0.02)
    # The capacity of other files: one program.
    orbit = vx.periodic_orbit(system, [-0.796289], [0.0600282], max_events=32)
    return orbit, vx.continuation(orbit, FREQUENCY, (2.4, 2.6), progress=False)


def test_an_orbit_lies_on_its_branch(followed):
    orbit, branch = followed
    assert KnownOrbits(starting_orbits(orbit)).on([0], [branch]) == {0: {0}}


def test_a_cycle_without_a_state_at_its_start_is_no_orbit(followed, monkeypatch):
    """Newton's method between two points may find flights of negative duration: no machine moves so."""

    def in_section(point, num_periods):
        yield from ()
        return End(EndKind.NOT_CONVERGED)

    monkeypatch.setattr(membership, "in_section", in_section)
    orbit, branch = followed
    assert KnownOrbits(starting_orbits(orbit)).on([0], [branch]) == {0: set()}
