"""Invariant circles of maps in closed form: no machine takes part."""

from typing import NamedTuple

import numpy as np
import pytest

from vijax._tori.circle import Circle, growth_rates, interpolation, rates
from vijax._tori.family import Limits, TorusEnd, TorusFamily, first_circle
from vijax._tori.section_map import Mapped

ROTATION, SHEAR = 0.2 * np.sqrt(2), 0.3
LIMITS = Limits(-0.1, 0.25, 100, 200, 1e-10)


class NormalForm(NamedTuple):
    """z -> z e^(2 pi i (rotation + shear |z|^2)) (1 + p - |z|^2) + resonance conj(z)^4, seen as a map of the plane.

    Without resonance the circle |z|^2 = p is invariant, with the rotation number `rotation` + `shear` p.
    """

    rotation: float = ROTATION
    resonance: float = 0.0

    def __call__(self, states, parameter):
        z = states[:, 0] + 1j * states[:, 1]
        square = np.abs(z) ** 2
        turn = np.exp(2j * np.pi * (self.rotation + SHEAR * square))
        size = 1 + parameter - square
        image = z * turn * size + self.resonance * z.conj() ** 4
        # Derivatives by z and by its conjugate.
        by_z = turn * (size - square + 2j * np.pi * SHEAR * square * size)
        by_conjugate = turn * z**2 * (2j * np.pi * SHEAR * size - 1) + 4 * self.resonance * z.conj() ** 3
        columns = [by_z + by_conjugate, 1j * (by_z - by_conjugate), z * turn]
        first, second, slope = (np.stack([a.real, a.imag], axis=-1) for a in columns)
        return Mapped(np.stack([image.real, image.imag], axis=-1), np.stack([first, second], axis=-1), slope)


def followed(section, limits=LIMITS):
    family = TorusFamily(section, limits, lambda: None)
    family.follow(first_circle(np.zeros(2), np.array([1.0, -1j]), section.rotation, 0.0))
    return family


def test_circles_of_a_normal_form_are_exact():
    family = followed(NormalForm())
    assert family.end == TorusEnd.BOUNDS
    assert family.found[-1].circle.parameter == LIMITS.high
    for one in family.found:
        states, rotation, parameter = one.circle
        np.testing.assert_allclose(np.hypot(*states.T) ** 2, parameter, rtol=0, atol=1e-13)
        assert rotation == pytest.approx(ROTATION + SHEAR * parameter, abs=1e-13)
        assert one.error < 1e-13
        along, across = growth_rates(one.circle, one.mapped.jacobians)
        assert along == 0
        assert across == pytest.approx(np.log(abs(1 - 2 * parameter)), abs=1e-12)


def test_a_resonance_is_met():
    """The circle that turns once in five sections gives way to periodic points, if the resonance is strong."""
    section = NormalForm(rotation=0.2 - SHEAR * 0.1, resonance=0.8)
    family = followed(section)
    assert family.end in (TorusEnd.LOCKED, TorusEnd.NOT_RESOLVED)
    assert family.found[-1].circle.parameter < 0.11
    locked = followed(section, LIMITS._replace(max_angles=33))
    assert locked.end in (TorusEnd.LOCKED, TorusEnd.NOT_RESOLVED)


def test_a_weak_resonance_is_passed():
    family = followed(NormalForm(rotation=0.2 - SHEAR * 0.1, resonance=1e-3))
    assert family.end == TorusEnd.BOUNDS
    assert max(one.error for one in family.found) < LIMITS.tolerance


def test_limits_are_kept():
    assert len(followed(NormalForm(), LIMITS._replace(max_points=3)).found) == 3
    assert followed(NormalForm(), LIMITS._replace(max_points=3)).end == TorusEnd.MAX_POINTS


def test_a_map_without_values_ends_the_family_at_once():
    class Nowhere(NormalForm):
        def __call__(self, states, parameter):
            found = super().__call__(states, parameter)
            return found._replace(states=np.full_like(found.states, np.nan))

    family = followed(Nowhere())
    assert (family.found, family.end) == ([], TorusEnd.NOT_CONVERGED)


@pytest.mark.parametrize("num", [33, 67])
def test_trigonometric_polynomials_are_interpolated(num):
    curve = lambda t: np.stack([np.cos(2 * np.pi * t) ** 3, np.sin(4 * np.pi * t)], axis=-1)  # noqa: E731
    slope = lambda t: np.stack(  # noqa: E731
        [-6 * np.pi * np.sin(2 * np.pi * t) * np.cos(2 * np.pi * t) ** 2, 4 * np.pi * np.cos(4 * np.pi * t)],
        axis=-1,
    )
    angles, states = np.linspace(-1.3, 2.1, 101), curve(np.arange(num) / num)
    np.testing.assert_allclose(interpolation(angles, num) @ states, curve(angles), rtol=0, atol=1e-13)
    np.testing.assert_allclose(rates(states), slope(np.arange(num) / num), rtol=0, atol=1e-12)
    finer = Circle(states, 0.1, 0.2).resampled(101).states
    np.testing.assert_allclose(finer, curve(np.arange(101) / 101), rtol=0, atol=1e-13)
