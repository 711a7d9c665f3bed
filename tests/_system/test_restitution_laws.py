"""Restitution laws beside Newton's: where they are kept, checked, printed and written."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import slow_except

import vijax as vx

# Some roundings.
ROUNDED = 1e-13


class Yielding(vx.AbstractRestitution):
    rules: ClassVar = {
        "elastic": vx.AbstractRestitution.COEFFICIENT,
        "speed": vx.AbstractRestitution.POSITIVE,
    }
    elastic: jax.Array
    speed: jax.Array

    def __call__(self, speed):
        return self.elastic * jnp.exp(-jnp.abs(speed) / self.speed)


def law(elastic=0.9, speed=2.0):
    return Yielding(elastic, speed)


def machine(*stops):
    load = vx.Harmonic(amplitude=[1.0, 0.0], frequency=0.9)
    return vx.ImpactSystem([1.0, 1.0], 0.02 * np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], load, stops)


MACHINES = {
    "one": machine(vx.Stop(0, 0.3, "upper", law())),
    "mixed": machine(vx.Stop(0, 0.3, "upper", law()), vx.Stop(1, 0.3, "upper", 0.7)),
    "two": machine(vx.Stop(0, 0.3, "upper", law()), vx.Stop(1, 0.3, "upper", law(0.8, 1.0))),
    "contact": machine(vx.Contact({0: 1.0, 1: -1.0}, 0.3, law()), vx.Stop(1, 0.3, "upper", 0.7)),
}


@pytest.mark.parametrize("name", slow_except(["one", "two"], MACHINES))
@pytest.mark.thorough
def test_every_impact_has_the_coefficient_of_its_speed(name):
    system = MACHINES[name]
    events = vx.simulate(system, 0.0, 80.0).events
    is_impact = events.kind == vx.IMPACT
    assert is_impact.sum() > 10
    for minus, plus, j in zip(
        events.velocity_minus[is_impact], events.velocity_plus[is_impact], events.stop[is_impact], strict=True
    ):
        own = system.stops[int(j)].restitution
        r = own(minus) if isinstance(own, Yielding) else own
        np.testing.assert_allclose(plus, -r * minus, rtol=ROUNDED, atol=ROUNDED)


@pytest.mark.slow
def test_its_numbers_are_swept_and_differentiated_by_their_paths():
    path, values = "stops[0].restitution.speed", np.array([0.5, 1.0, 2.0])
    ds = vx.sweep(MACHINES["one"], {path: values}, transient=0, record=5, progress=False)
    for value, x in zip(values, ds.x.values, strict=True):
        system = machine(vx.Stop(0, 0.3, "upper", law(speed=value)))
        one = vx.simulate(system, 0.0, 5 * system.forcing.period)
        np.testing.assert_allclose(x, one.x1, rtol=0, atol=1e-11)

    def end(speed):
        return vx.simulate(machine(vx.Stop(0, 0.3, "upper", law(speed=speed))), 0.0, 20.0).x1

    difference = (end(2.0 + 1e-6) - end(2.0 - 1e-6)) / 2e-6
    np.testing.assert_allclose(jax.jacfwd(end)(2.0), difference, rtol=1e-6)
    np.testing.assert_allclose(jax.jacrev(end)(2.0), jax.jacfwd(end)(2.0), rtol=1e-10)


@pytest.mark.parametrize("name", MACHINES)
def test_it_is_written_and_read_bit_for_bit(name, tmp_path):
    vx.save(MACHINES[name], tmp_path / "machine.toml")
    read = vx.load(tmp_path / "machine.toml")
    assert repr(read) == repr(MACHINES[name])
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), read, MACHINES[name]))
    assert "Yielding(elastic=0.9, speed=2)" in repr(read.stops[0])


def test_a_law_without_rules_is_refused():
    class Lawless(Yielding):
        rules: ClassVar = {"elastic": vx.AbstractRestitution.COEFFICIENT}

    with pytest.raises(ValueError, match="must give a rule for `speed`"):
        vx.Stop(0, 0.3, "upper", Lawless(0.9, 2.0))


def test_what_is_wrong_with_it_is_a_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"`restitution.elastic` must lie between 0 \(plastic\) and 1"):
        vx.Stop(0, 0.3, "upper", law(elastic=1.5))
    with pytest.raises(ValueError, match=r"`restitution.speed` must be a number, but has shape \(2,\)"):
        vx.Stop(0, 0.3, "upper", law(speed=[1.0, 2.0]))
    with pytest.raises(ValueError, match=r"stops\[0\].restitution.speed` must be positive"):
        vx.sweep(
            MACHINES["one"],
            {"stops[0].restitution.speed": [1.0, -1.0]},
            transient=0,
            record=1,
            progress=False,
        )
    file = tmp_path / "machine.toml"
    vx.save(MACHINES["one"], file)
    file.write_text(file.read_text().replace("Yielding", "Yeilding"))
    with pytest.raises(
        ValueError, match=r"`stops\[0\].restitution` must be a number, or a table with `law`, one of"
    ):
        vx.load(file)
