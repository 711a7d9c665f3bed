"""Pictures of masses that are loose in another one, their container."""

import numpy as np
import pytest
from drawn_machines import (
    boxes,
    called,
    cavity_with,
    height_of,
    middle,
    rigid_ends,
    wall_at,
)

import vijax as vx
from vijax.studio.drawing.arrangement import arrangement_of
from vijax.studio.drawing.reading import scheme_of_solution, scheme_of_system

# Positions in a drawing are sums and products of a few numbers of size 10.
ROUNDING = 1e-13


@pytest.mark.parametrize("number", [0, 1])
def test_a_loose_mass_is_drawn_in_its_container(number):
    """Container and loose mass in either order, with ends at different distances, and a mass beside them."""
    own, loose = number, 1 - number
    stiffness = np.zeros((3, 3))
    stiffness[own, own], stiffness[2, 2] = 2.0, 1.0
    stiffness[own, 2] = stiffness[2, own] = -1.0
    ends = [vx.Contact({loose: 1.0, own: -1.0}, 1.0, 0.6), vx.Contact({own: 1.0, loose: -1.0}, 0.5, 0.6)]
    load = vx.Harmonic([0.0, 0.0, 1.0], 1.0)
    system = vx.ImpactSystem([1.0, 1.0, 1.0], 0 * stiffness, stiffness, load, ends)
    assert scheme_of_system(system).containers == {loose: own}
    home = arrangement_of(scheme_of_system(system)).home
    assert home[own] == home[loose] < home[2]
    x = np.zeros(3)
    x[own], x[loose] = 0.2, -0.1
    ax = vx.plot.machine(system, x)
    masses = boxes(ax)
    outside, inside, beside = masses[own], masses[loose], masses[2]
    scale = (middle(outside) - home[own]) / x[own]
    faces = [inside.get_x() + inside.get_width(), inside.get_x()]
    gaps = [wall_at(ax, 0) - faces[0], faces[1] - wall_at(ax, 1)]
    np.testing.assert_allclose(gaps, scale * np.array([1 + 0.3, 0.5 - 0.3]), rtol=0, atol=ROUNDING)
    (cavity,) = called(ax, f"cavity {loose}")
    assert cavity.get_x() == wall_at(ax, 1)
    assert outside.get_x() < cavity.get_x()
    assert cavity.get_x() + cavity.get_width() < outside.get_x() + outside.get_width() < beside.get_x()
    (line,) = (line for line in called(ax, "spring") if max(line.get_xdata()) > middle(outside))
    assert line.get_xdata()[0] == pytest.approx(outside.get_x() + outside.get_width())


@pytest.mark.thorough
def test_a_loose_mass_that_rubs_on_its_container_lies_on_a_pad_in_it():
    rubbing = [vx.Friction({1: -1.0, 0: 1.0}, force=0.1), vx.Friction(0, force=0.3)]
    system, x = cavity_with(rigid_ends(), rubbing), np.array([0.1, -0.2])
    ax = vx.plot.machine(system, x)
    ((cavity,), (pad,), (floor_pad,)) = (
        called(ax, name) for name in ("cavity 1", "friction 0", "friction 1")
    )
    container, loose = boxes(ax)
    assert middle(pad) == pytest.approx(middle(loose), abs=ROUNDING)
    assert middle(floor_pad) == pytest.approx(middle(container), abs=ROUNDING)
    assert height_of(pad)[0] == pytest.approx(height_of(cavity)[0])
    assert height_of(pad)[1] == pytest.approx(height_of(loose)[0])
    assert height_of(loose)[1] < height_of(cavity)[1]
    scheme = scheme_of_solution(vx.simulate(system, 0.0, 0.0), np.zeros((1, 2)))
    assert scheme.pads == scheme_of_system(system).pads


def test_what_rubs_on_the_ground_is_in_no_container():
    system = cavity_with(rigid_ends(), [vx.Friction(1, force=0.1)])
    assert not scheme_of_system(system).containers


def test_what_is_linked_loaded_or_one_of_several_is_in_no_container():
    ends = [vx.Contact({1: 1.0, 0: -1.0}, 1.0, 0.6), vx.Contact({0: 1.0, 1: -1.0}, 1.0, 0.6)]
    held = np.diag([1.0, 0.0])
    known = {"linked": np.eye(2), "nothing holds it": 0 * held}
    for stiffness in known.values():
        system = vx.ImpactSystem([1.0, 1.0], 0 * held, stiffness, vx.Harmonic([1.0, 0.0], 1.0), ends)
        assert not scheme_of_system(system).containers
    loaded = vx.ImpactSystem([1.0, 1.0], 0 * held, held, vx.Harmonic([1.0, 0.0], 1.0, mean=[0.0, -1.0]), ends)
    assert not scheme_of_system(loaded).containers
    two = [vx.Contact({2: 1.0, 0: -1.0}, 1.0, 0.6), vx.Contact({0: 1.0, 2: -1.0}, 1.0, 0.6)]
    several = vx.ImpactSystem(
        [1.0] * 3,
        np.zeros((3, 3)),
        np.diag([1.0, 0.0, 0.0]),
        vx.Harmonic([1.0, 0.0, 0.0], 1.0),
        [*ends, *two],
    )
    assert not scheme_of_system(several).containers
    assert scheme_of_system(vx.models.impact_damper(1.0)).containers == {1: 0}
    assert not scheme_of_system(vx.models.gear_pair(1.0, 1.0)).containers
