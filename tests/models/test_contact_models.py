"""Parameters of ready-made machines with contacts between masses, full mass matrices and moving walls."""

import jax.numpy as jnp
import pytest
from helpers import assert_depends_on_every_parameter
from model_roundings import EXACT

import vijax as vx

PARAMETERS = {
    "impact_damper": {
        "frequency": 0.9,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.7,
        "restitution": 0.6,
        "damping_ratio": 0.1,
        "mass_ratio": 0.2,
    },
    "gear_pair": {
        "frequency": 2.0,
        "amplitude": 1.5,
        "phase": 0.3,
        "torque": 0.7,
        "position": 0.1,
        "restitution": 0.6,
        "inertias": jnp.array([2.0, 1.5]),
        "radii": jnp.array([1.2, 0.8]),
        "damping": 0.1,
    },
    "cantilever": {
        "frequency": 2.0,
        "amplitude": 1.5,
        "phase": 0.3,
        "position": 0.1,
        "restitution": 0.6,
        "length": 1.3,
        "bending_stiffness": 2.0,
        "mass_per_length": 0.7,
        "damping_ratio": 0.1,
    },
    "multi_piston": {
        "frequency": 1.2,
        "amplitudes": jnp.array([0.3, 0.4]),
        "phases": jnp.array([0.5, -0.2]),
        "positions": jnp.array([0.1, 0.2]),
        "mass_ratios": jnp.array([0.2, 0.3]),
        "restitution": 0.6,
        "gravity": 0.3,
    },
    "ball_between_walls": {
        "frequency": 2.0,
        "amplitude": 0.2,
        "phase": 0.3,
        "position": 1.5,
        "restitution": 0.6,
        "mass": 2.0,
    },
    "bead_column": {
        "frequency": 2.0,
        "amplitude": 0.2,
        "phase": 0.3,
        "position": 5.0,
        "diameter": 0.1,
        "restitution": 0.6,
        "gravity": 2.0,
        "mass": jnp.array([2.0, 1.0, 0.5]),
    },
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_of_a_model_may_be_traced_and_differentiated(name):
    assert_depends_on_every_parameter(getattr(vx.models, name), PARAMETERS[name], EXACT)


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (
            lambda: vx.models.gear_pair(1.0, 1.0, radii=[1.0]),
            r"`radii` must have shape \(2,\), but has shape \(1,\)",
        ),
        (
            lambda: vx.models.cantilever(1.0, num_elements=0),
            "`num_elements` must be a whole number, 1 or more, but is 0",
        ),
        (
            lambda: vx.models.bead_column(num_beads=0),
            "`num_beads` must be a whole number, 1 or more, but is 0",
        ),
        (
            lambda: vx.models.ball_between_walls(1.0, jnp.array([0.1])),
            r"`amplitude` must be a number, but has shape \(1,\)",
        ),
    ],
)
def test_what_is_no_machine_is_refused(build, sentence):
    with pytest.raises(ValueError, match=sentence):
        build()
