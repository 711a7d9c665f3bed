"""Bodies that touch without a force all along: cradles, symmetric chains, equal drag, a ball in its container, blocks at their bound."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import vijax as vx

pytestmark = pytest.mark.thorough

EXACT = 1e-12
# Of a few dozen steps, and no more.
FEW_STEPS = 100
SWING = np.sqrt(49.05)


def hanging(mass, restitution=1.0, *, compliant=False) -> vx.ImpactSystem:
    """Pendula in a row, in touch, which all swing with one frequency."""
    rows = [{i: 1.0, i + 1: -1.0} for i in range(len(mass) - 1)]
    stops = [
        vx.CompliantContact(row, 0.0, 1e3) if compliant else vx.Contact(row, 0.0, restitution) for row in rows
    ]
    nothing = np.zeros((len(mass), len(mass)))
    return vx.ImpactSystem(mass, nothing, SWING**2 * jnp.diag(jnp.asarray(mass)), None, stops)


def swung(mass, lifted: int, restitution: float, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Motion of pendula of which the first are lifted by 1, after Moreau's law.

    All meet at the lowest point, twice in a period. The contact between the lifted ones and the others is hit, all are closed: v changes
    to (1 + r) V - r v, V the velocity of the centre of mass.
    """
    v, hit = -SWING * (np.arange(len(mass)) < lifted), -np.pi / 2 / SWING
    while hit + np.pi / SWING < t:
        hit += np.pi / SWING
        centre = mass @ -v / np.sum(mass)
        v = (1 + restitution) * centre + restitution * v
    phase = SWING * (t - hit)
    return v / SWING * np.sin(phase), v * np.cos(phase)


@pytest.mark.parametrize("lifted", [1, 2, 3])
@pytest.mark.parametrize(
    ("mass", "restitution"),
    [
        ([1.0, 1.0, 1.0], 1.0),
        ([1.0, 3.0, 0.2], 1.0),
        ([1.0, 1.0, 1.0], 0.5),
        pytest.param([1.0] * 5, 1.0, marks=pytest.mark.slow),
        pytest.param([2.0, 1.0, 1.0, 0.3], 0.7, marks=pytest.mark.slow),
    ],
)
def test_lifted_pendula_of_a_cradle_in_touch_swing_by_the_law_of_several_impacts(mass, restitution, lifted):
    mass = np.array(mass)
    x0 = -0.1 * (np.arange(len(mass)) < lifted)
    sol = vx.simulate(hanging(mass, restitution), 0.0, 3.0, x0, max_steps=1000)
    x, v = swung(mass, lifted, restitution, 3.0)
    np.testing.assert_allclose(sol.x1, 0.1 * x, rtol=0, atol=EXACT)
    np.testing.assert_allclose(sol.v1, 0.1 * v, rtol=0, atol=10 * EXACT)


@pytest.mark.slow
def test_a_cradle_in_touch_is_the_same_in_any_unit_side_by_side_and_grows_with_its_start():
    mass = np.array([1.0, 3.0, 0.2])

    def end(size, unit):
        x0 = -size * jnp.array([1.0, 0.0, 0.0])
        return vx.simulate(hanging(mass * unit), 0.0, 3.0, x0, max_steps=1000).x1

    expected = swung(mass, 1, 1.0, 3.0)[0]
    sizes, units = np.array([1e-9, 0.1, 1e3]), np.array([1.0, 1 / 7, 3.0])
    found = jax.vmap(end)(sizes, units)
    np.testing.assert_allclose(found / sizes[:, None], [expected] * 3, rtol=0, atol=1e-11)
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jacobian(end)(0.1, 3.0), expected, rtol=0, atol=1e-10)


def chain(num: int, contact) -> vx.ImpactSystem:
    """A symmetric chain between walls whose ends would meet."""
    stiffness = 2 * np.eye(num) - np.eye(num, k=1) - np.eye(num, k=-1)
    return vx.ImpactSystem(np.ones(num), 0.02 * stiffness, stiffness, None, [contact])


CONTACTS = {
    "rigid": lambda row: vx.Contact(row, 0.0, 0.6),
    "plastic": lambda row: vx.Contact(row, 0.0, 0.0),
    "compliant": lambda row: vx.CompliantContact(row, 0.0, 100.0),
    "damped": lambda row: vx.CompliantContact(row, 0.0, 100.0, 0.5),
}
_SLOW = [
    pytest.param(name, marks=pytest.mark.slow) if name in ("plastic", "damped") else name for name in CONTACTS
]


@pytest.mark.parametrize("name", _SLOW)
@pytest.mark.parametrize("num", [2, 3])
def test_a_symmetric_motion_of_a_chain_does_not_feel_the_contact_of_its_ends(num, name):
    system = chain(num, CONTACTS[name]({0: 1.0, num - 1: -1.0}))
    x0 = np.array([0.1, 0.3, 0.1] if num == 3 else [0.1, 0.1])
    sol = vx.simulate(system, 0.0, 30.0, x0, max_steps=1000)
    nothing, stiffness = np.zeros((num, num)), np.asarray(system.stiffness)
    rates = np.block([[nothing, np.eye(num)], [-stiffness, -0.02 * stiffness]])
    right = expm(30.0 * rates) @ np.append(x0, np.zeros(num))
    np.testing.assert_allclose(np.append(sol.x1, sol.v1), right, rtol=0, atol=1e-11)
    assert sol.num_steps < FEW_STEPS


@pytest.mark.parametrize("name", _SLOW)
@pytest.mark.parametrize("mass", [[1.0, 1.0], [1.0, 2.5, 0.3]])
def test_falling_bodies_of_equal_drag_stay_in_touch(mass, name):
    mass, drag, weight = np.array(mass), 0.3, 0.7
    num = len(mass)
    stops = [CONTACTS[name]({i: 1.0, i + 1: -1.0}) for i in range(num - 1)]
    load = vx.Harmonic(np.zeros(num), 1.0, mean=weight * mass)
    system = vx.ImpactSystem(mass, drag * np.diag(mass), np.zeros((num, num)), load, stops)
    sol = vx.simulate(system, 0.0, 30.0, [0.1] * num, [1.0] * num, max_steps=1000)
    final = weight / drag
    fallen = 0.1 + final * 30.0 + (1 - final) * (1 - np.exp(-drag * 30.0)) / drag
    np.testing.assert_allclose(sol.x1, fallen, rtol=1e-13)
    assert sol.num_events == 0
    assert sol.num_steps < FEW_STEPS


@pytest.mark.slow
@pytest.mark.parametrize("rigid", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_ball_at_the_end_of_its_container_rides_on_a_shaken_base_in_a_sweep_too(rigid):
    """In the frame of the base both have the same acceleration: nothing presses, whatever the gap of the other end."""
    mass = np.array([1.0, 0.2])
    ends = ({0: 1.0, 1: -1.0}, 0.0), ({1: 1.0, 0: -1.0}, 0.5)
    stops = [vx.Contact(*end, 0.6) if rigid else vx.CompliantContact(*end, 80.0) for end in ends]
    nothing = np.zeros((2, 2))
    system = vx.ImpactSystem(mass, nothing, nothing, vx.Harmonic(0.4 * mass, 0.9), stops)
    sol = vx.simulate(system, 0.0, 30.0, max_steps=1000)
    np.testing.assert_allclose(sol.x1, 0.4 / 0.81 * (1 - np.cos(27.0)), rtol=0, atol=1e-11)
    assert sol.num_events == 0
    frequencies = np.linspace(0.7, 1.1, 5)
    ds = vx.sweep(system, {"forcing.frequency": frequencies}, transient=3, record=2, progress=False)
    assert (ds.result == 0).all()
    np.testing.assert_allclose(ds.x, 0, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("mass", "static"),
    [
        ([1.0, 1.0], None),
        pytest.param([1.0, 2.0], None, marks=pytest.mark.slow),
        pytest.param([3.0, 0.5], 1.0, marks=pytest.mark.slow),
        pytest.param([1.0, 2.0], 1.3, marks=pytest.mark.slow),
    ],
)
def test_blocks_whose_friction_is_at_its_bound_all_along_ride_together(mass, static):
    """The lowest slides; it drives those above by 0.9. Between these acts what the uppermost needs, which is the bound."""
    mass, drive = np.array(mass), 0.9
    between = drive * mass[1] / mass.sum()
    friction = [
        vx.Friction(0, 1.5),
        vx.Friction({1: 1.0, 0: -1.0}, drive),
        vx.Friction({2: 1.0, 1: -1.0}, between, None if static is None else static * between),
    ]
    masses, drag = np.append(1.0, mass), 0.1
    load = vx.Harmonic([6.0, 0.0, 0.0], 0.7)
    system = vx.ImpactSystem(
        masses, drag * np.diag(masses), np.diag([1.0, 0, 0]), load, [], friction=friction
    )
    found = jax.vmap(lambda end: vx.simulate(system, 0.0, end, max_steps=1000).x1[1:])(jnp.array([0.4, 1.0]))
    for x, end in zip(found, (0.4, 1.0), strict=True):
        way = drive / mass.sum() / drag * (end - (1 - np.exp(-drag * end)) / drag)
        np.testing.assert_allclose(x, way, rtol=0, atol=1e-11)
