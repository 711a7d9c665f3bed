"""Kinds of motions of machines with full mass matrices and contacts."""

import jax.numpy as jnp
import numpy as np
import pytest
from exact_orbits import exact_orbit

import vijax as vx

DAMPING, FREQUENCY, RESTITUTION, POSITION = 0.1, 2.2, 0.8, 0.1
# Coupling of the second coordinate to the first: q_1 = x_1 + SHARE x_0.
SHARE = 0.7
SPREAD = np.array([[1.0, 0.0], [SHARE, 1.0]])


def with_a_full_mass(amplitude: float, phase: float, contact: vx.Stop | vx.Contact) -> vx.ImpactSystem:
    """A mass on a spring with a stop, and a second mass, in coordinates in which both share inertia."""
    mass, damping, stiffness = (
        SPREAD.T @ np.diag(a) @ SPREAD for a in ([1.0, 2.0], [DAMPING, 0.3], [1.0, 5.0])
    )
    load = vx.Harmonic([amplitude, 0.0], FREQUENCY, [phase, 0.0])
    return vx.ImpactSystem(mass, damping, stiffness, load, [contact])


pytestmark = pytest.mark.thorough

STOP = vx.Stop(0, POSITION, "upper", RESTITUTION)
CONTACT = vx.Contact({0: 2.0}, 2 * POSITION, RESTITUTION)
MOVING = vx.Stop(
    0, POSITION - 0.05, "upper", RESTITUTION, vx.Harmonic([[0.0]], FREQUENCY, mean=jnp.array([0.05]))
)


@pytest.mark.slow
@pytest.mark.parametrize("contact", [STOP, CONTACT, MOVING], ids=["stop", "contact", "moving"])
def test_an_impact_as_periods_end_is_undone_of_all_masses_that_it_sets_in_motion(contact):
    period = 2 * np.pi / FREQUENCY
    orbit = exact_orbit(DAMPING, 1.0, 1.0, FREQUENCY, POSITION, RESTITUTION, period, 1)
    phase, (x, v) = orbit.start(0.0)
    # The other mass is at rest in its own coordinate.
    back = np.linalg.inv(SPREAD)[:, 0]
    system, x0, v0 = with_a_full_mass(1.0, phase, contact), x * back, v * back
    points = {"forcing.frequency": FREQUENCY * (1 + 1e-13 * np.array([-1.0, 0.0, 1.0]))}
    ds = vx.sweep(system, points, transient=0, record=16, x0=x0, v0=v0, progress=False)
    sol = vx.simulate(system, 0.0, 16.2 * period, x0, v0)
    for source in (sol, ds):
        # Rounding puts some of these impacts before the end of their period and some after.
        motions = vx.classify(source, last=16)
        assert (motions.num_periods == 1).all()
        assert (motions.num_impacts == 1).all()
        assert (motions.recurrence_error < 1e-9).all()


@pytest.mark.parametrize("margin", [1e-6, -1e-6])
@pytest.mark.slow
def test_a_motion_that_never_reaches_a_moving_contact_is_proved_quiet(margin):
    """The contact is just beyond or just within the response to the load."""
    travel, row = 0.05 * np.exp(0.7j), np.array([1.0, -0.4])
    system = with_a_full_mass(1.0, 0.3, MOVING)
    mass, damping, stiffness = (np.asarray(a) for a in (system.mass, system.damping, system.stiffness))
    push = np.array([np.exp(0.3j), 0.0])
    wave = np.linalg.solve(stiffness - FREQUENCY**2 * mass + 1j * FREQUENCY * damping, push)
    nearest = abs(row @ wave - travel)
    motion = vx.Harmonic([[abs(travel)]], FREQUENCY, [[np.angle(travel)]])
    contact = vx.Contact(dict(enumerate(row)), nearest * (1 + margin), RESTITUTION, motion)
    system = with_a_full_mass(1.0, 0.3, contact)
    rate = 1j * FREQUENCY * wave
    sol = vx.simulate(system, 0.0, 16.2 * 2 * np.pi / FREQUENCY, wave.real, rate.real)
    motions = vx.classify(sol)
    is_hit = int(sol.num_events) > 0
    assert is_hit == (margin < 0)
    kinds = motions.motion.attrs["flag_meanings"].split()
    if is_hit:
        assert kinds[int(motions.motion)] != "non_impacting"
        return
    assert kinds[int(motions.motion)] == "non_impacting"
    first_order = np.block(
        [[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
    )
    slowest = np.linalg.eigvals(first_order).real.max()
    # The section does not contain this contraction: it is from the proof.
    assert float(motions.contraction) == pytest.approx(np.exp(slowest * 2 * np.pi / FREQUENCY), rel=1e-12)


@pytest.mark.slow
def test_impacts_at_one_instant_end_at_the_rounding_of_velocities():
    """A heavy mass crushes a light one against a stop that moves away: all end at the velocity of the stop."""
    system = vx.ImpactSystem(
        [8.81, 0.18],
        [[0.0338, -0.00161], [-0.00161, 0.00833]],
        [[4.96, -0.236], [-0.236, 1.22]],
        vx.Harmonic([0.0, 0.902], 0.457, [2.77, 5.53], [0.0, -0.0534]),
        [
            vx.Stop(1, -0.288, "lower", 0.278, vx.Harmonic([0.144], 0.457)),
            vx.Contact({0: 1.0, 1: -1.0}, 0.694, 0.611),
            vx.Contact({1: 1.0, 0: -1.0}, 0.62, 0.611),
        ],
    )
    sol = vx.simulate(system, 0.0, 60.0, v0=[2.29, 0.576], max_events=4096)
    assert sol.num_events < 4096
