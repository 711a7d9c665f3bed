"""An oblique impact of a slender rod by three laws: that of vijax, and what the page on friction tells of the others."""

import numpy as np
import pytest

import vijax as vx

# A rod of mass 1 and length 2 at 45 degrees: inverse inertia of its end along the normal, the tangent, and between them.
NORMAL = TANGENT = 2.5
BETWEEN, FRICTION = 1.5, 0.3
_PRINTED = 5e-4


def newton(r: float) -> np.ndarray:
    """Newton's law in Moreau's form, where friction stops the slip."""
    p, rubbed = np.linalg.solve([[NORMAL, BETWEEN], [BETWEEN, TANGENT]], [1 + r, 1.0])
    assert abs(rubbed) <= FRICTION * p
    return np.array([-r, 0.0])


def poisson(r: float) -> np.ndarray:
    """Compression until the approach ends, then r times its impulse; friction stops the slip only in the second."""
    p = 1 / (NORMAL + FRICTION * BETWEEN)
    w = 1 - (BETWEEN + FRICTION * TANGENT) * p
    assert w > 0
    more = r * p
    rubbed = (w - BETWEEN * more) / TANGENT
    assert abs(rubbed) <= FRICTION * more
    return np.array([-NORMAL * more - BETWEEN * rubbed, 0.0])


def stronge(r: float) -> np.ndarray:
    """Routh's path: slip stops and reverses during the impact; the work of expansion is r^2 times that of compression."""
    ahead, behind = NORMAL + FRICTION * BETWEEN, NORMAL - FRICTION * BETWEEN
    stops = 1 / (BETWEEN + FRICTION * TANGENT)
    leaving = ahead * stops - 1
    assert leaving > 0  # compression is over
    assert BETWEEN / TANGENT > FRICTION  # friction cannot hold
    left = r**2 / (2 * ahead) - leaving**2 / (2 * ahead)
    u = np.sqrt(leaving**2 + 2 * behind * left)
    return np.array([-u, -(BETWEEN - FRICTION * TANGENT) * (u - leaving) / behind])


def energy(after: np.ndarray) -> float:
    """Share of the kinetic energy that is left."""
    of = np.linalg.inv([[NORMAL, BETWEEN], [BETWEEN, TANGENT]])
    return float(after @ of @ after / np.sum(of))


@pytest.mark.parametrize(
    ("law", "r", "printed"),
    [
        (newton, 0.5, (0.500, 0.000, 0.3125)),
        (poisson, 0.5, (0.414, 0.000, 0.214)),
        (stronge, 0.5, (0.451, -0.051, 0.223)),
        (newton, 0.8, (0.800, 0.000, 0.800)),
        (poisson, 0.8, (0.576, 0.000, 0.415)),
        (stronge, 0.8, (0.689, -0.138, 0.474)),
    ],
)
def test_the_page_tells_the_velocities_after_the_impact(law, r, printed):
    u, w = law(r)
    np.testing.assert_allclose([-u, w, energy(np.array([u, w]))], printed, rtol=0, atol=_PRINTED)


@pytest.mark.slow
@pytest.mark.parametrize("r", [0.5, 0.8])
def test_the_rod_leaves_as_newtons_law_says(r):
    """Coordinates are x, y, and the angle; the end is at the floor at the start."""
    arm = np.sqrt(0.5)
    floor = vx.Contact({1: -1.0, 2: arm}, 0.0, restitution=r)
    rubbing = vx.Friction({0: 1.0, 2: arm}, coefficient=FRICTION, contact=0)
    row, tangent, inverse = np.array([0.0, -1.0, arm]), np.array([1.0, 0.0, arm]), np.diag([1.0, 1.0, 3.0])
    inertia = [row @ inverse @ row, row @ inverse @ tangent, tangent @ inverse @ tangent]
    np.testing.assert_allclose(inertia, [NORMAL, BETWEEN, TANGENT], rtol=1e-14)
    none, load = np.zeros((3, 3)), vx.Harmonic(np.zeros(3), 1.0)
    rod = vx.ImpactSystem([1.0, 1.0, 1 / 3], none, none, load, [floor], friction=[rubbing])
    sol = vx.simulate(rod, 0.0, 0.1, np.zeros(3), [1.0, -1.0, 0.0])
    assert int(sol.num_events) == 1
    np.testing.assert_allclose([row @ sol.v1, tangent @ sol.v1], newton(r), rtol=0, atol=1e-14)
