"""Branches of machines with friction or sliders side by side: those of one element, whatever the sum is made of."""

import numpy as np
import pytest

import vijax as vx

FREQUENCY, BOUNDS = 2.2, (2.1, 2.5)
# Of what Newton's method finds.
FOUND = 1e-9


def machine(stiffness=1.0, **elements):
    load, stop = vx.Harmonic([0.5], FREQUENCY), vx.Stop(0, 0.1, "upper", 0.7)
    return vx.ImpactSystem([1.0], [[0.1]], [[stiffness]], load, [stop], **elements)


def branch_of(system):
    settled = vx.simulate(system, 0.0, 200 * 2 * np.pi / FREQUENCY, max_events=4096)
    orbit = vx.periodic_orbit(system, settled.x1, settled.v1)
    return vx.continuation(orbit, "forcing.frequency", BOUNDS, progress=False)


def friction(*elements):
    return machine(friction=[vx.Friction(*one) for one in elements])


def sliders(*elements):
    return machine(0.95, hysteresis=[vx.Jenkins(0, *one) for one in elements])


def check_alike(several, one):
    assert several.ends == one.ends == ("bounds", "bounds")
    assert [b.kind for b in several.bifurcations] == [b.kind for b in one.bifurcations] == ["pd", "gr"]
    np.testing.assert_allclose(
        [b.value for b in several.bifurcations], [b.value for b in one.bifurcations], rtol=0, atol=FOUND
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("several", "one"),
    [
        (friction((0, 0.02), (0, 0.03)), friction((0, 0.05))),
        # Along the opposite row, of twice its length, and with a larger force of stick.
        (friction((0, 0.02, 0.03), ({0: -2.0}, 0.015, 0.02)), friction((0, 0.05, 0.07))),
        (sliders((0.025, 0.00125), (0.025, 0.00125)), sliders((0.05, 0.0025))),
    ],
    ids=["friction", "friction along opposite rows", "sliders"],
)
def test_a_branch_is_that_of_one_element(several, one):
    check_alike(branch_of(several), branch_of(one))


@pytest.mark.slow
def test_sliders_of_different_limits_come_to_rest_in_one_event():
    """An Iwan element, of which an equal one has four sliders."""
    two = branch_of(sliders((0.025, 0.00125), (0.025, 0.001)))
    four = branch_of(sliders(*2 * [(0.0125, 0.000625)], *2 * [(0.0125, 0.0005)]))
    check_alike(two, four)
    orbit = two.orbit(0)
    log = orbit.events
    rests = np.asarray(log.stop)[np.asarray(log.kind) == vx.STICK].tolist()
    assert rests == [1, 2, 1, 2]  # the log has both


@pytest.mark.slow
def test_the_log_of_an_orbit_has_the_turns_of_all_elements():
    several = branch_of(friction((0, 0.02), (0, 0.03))).orbit(0).events
    turns = np.asarray(several.kind) == vx.TURN
    np.testing.assert_array_equal(np.asarray(several.stop)[turns], [1, 2])
    times = np.asarray(several.t)[turns]
    np.testing.assert_allclose(times[0], times[1], rtol=0, atol=1e-12)
