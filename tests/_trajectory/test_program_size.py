"""The size of programs, in lines of their lowered text, by the kind of machine: time to compile follows it, on any machine."""

import jax
import jax.numpy as jnp
import pytest

import vijax as vx

pytestmark = pytest.mark.thorough

# A tenth above the number of lines with JAX 0.10; 0.12 writes fewer. A change that needs more says so here.
MOST = {
    "1 stop": (4013, 6440),
    "2 stops": (4999, 9266),
    "contact": (8261, 13025),
    "friction": (8527, 14109),
    "compliant": (10783, 19484),
    "mixed": (15747, 31700),
}
SLACK = 1.1


def stop(mass: int) -> vx.Stop:
    return vx.Stop(mass, 0.5 + 0.1 * mass, "upper", 0.7)


def soft(mass: int) -> vx.CompliantStop:
    return vx.CompliantStop(mass, 0.5 + 0.1 * mass, "upper", 20.0, 0.1)


def machine(n: int, limits=(), friction=()) -> vx.ImpactSystem:
    load = vx.Harmonic([1.0] + [0.0] * (n - 1), 0.9)
    own = vx.chain([1.0 + 0.1 * k for k in range(n)], [0.05] * n, [1.0] * n, load, list(limits))
    return vx.ImpactSystem(own.mass, own.damping, own.stiffness, load, own.stops, friction=list(friction))


MACHINES = {
    "1 stop": machine(1, [stop(0)]),
    "2 stops": machine(2, [stop(0), stop(1)]),
    "contact": machine(2, [vx.Contact({0: 1.0, 1: -1.0}, 0.9, 0.5)]),
    "friction": machine(2, (), [vx.Friction(0, 0.1)]),
    "compliant": machine(2, [soft(0), soft(1)]),
    "mixed": machine(2, [stop(0), soft(0)], [vx.Friction(0, 0.1)]),
}


@pytest.mark.parametrize("name", MACHINES)
def test_programs_are_no_larger_than_known(name):
    system = MACHINES[name]
    n = system.num_masses
    end = lambda x: vx.simulate(system, 0.0, 10.0, x, jnp.zeros(n), throw=False)  # noqa: E731
    one = jax.jit(end).lower(jnp.zeros(n)).as_text().count("\n")
    many = jax.jit(jax.vmap(end)).lower(jnp.zeros((64, n))).as_text().count("\n")
    for lines, most in zip((one, many), MOST[name], strict=True):
        assert 0.5 * most < lines <= SLACK * most
