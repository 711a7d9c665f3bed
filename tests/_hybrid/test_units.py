"""The outcome of an instant does not depend on the units of mass, length and time."""

import numpy as np
import pytest
from switching_scenes import data_of, scene_names, scene_of

# Factors of mass, length and time.
_UNITS = {
    "mass 3": (3, 1, 1),
    "mass 1/7": (1 / 7, 1, 1),
    "length": (1, 1e-6, 1),
    "time": (1, 1, 1e3),
    "all": (3, 1e-6, 1e3),
}
_FIELDS = {
    "M": (1, 0, 0), "C": (1, 0, -1), "K": (1, 0, -2), "A": (1, 1, -2), "mean": (1, 1, -2), "Omega": (0, 0, -1),
    "t0": (0, 0, 1), "t1": (0, 0, 1), "x0": (0, 1, 0), "v0": (0, 1, -1),
}  # fmt: skip
_OF_ELEMENTS = {
    "position": (0, 1, 0), "stiffness": (1, 0, -2), "damping": (1, 0, -1), "preload": (1, 1, -2),
    "force": (1, 1, -2), "static": (1, 1, -2), "belt": (0, 1, -1),
}  # fmt: skip


def _in_units(data: dict, units: tuple) -> dict:
    factor = lambda powers: float(np.prod([u**p for u, p in zip(units, powers, strict=True)]))  # noqa: E731
    new = {name: (np.array(data[name]) * factor(powers)).tolist() for name, powers in _FIELDS.items()}
    for kind in ("contacts", "compliant", "friction"):
        new[kind] = [
            {
                name: a * factor(_OF_ELEMENTS[name]) if name in _OF_ELEMENTS else a
                for name, a in element.items()
            }
            for element in data[kind]
        ]
    return data | new


# Scenes whose machine compiles fastest; all take minutes.
_QUICK = ("lets_go_three",)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(a, marks=pytest.mark.thorough if a in _QUICK else pytest.mark.slow)
        for a in scene_names("golden_mixed")
    ],
)
def test_scenes_of_touching_bodies_are_the_same_in_any_unit(name):
    scene = scene_of(name, data_of(name))
    expected = scene.simulate()
    n = int(expected.num_events)
    for units in _UNITS.values():
        _, length, time = units
        found = scene_of(name, _in_units(scene.data, units)).simulate()
        assert int(found.num_events) == n, units
        for field in ("kind", "stop"):
            np.testing.assert_array_equal(
                getattr(found.events, field), getattr(expected.events, field), str(units)
            )
        tolerance = 100 * scene.state_tolerance
        np.testing.assert_allclose(found.x1 / length, expected.x1, rtol=0, atol=tolerance, err_msg=str(units))
        np.testing.assert_allclose(
            found.v1 / length * time, expected.v1, rtol=0, atol=tolerance, err_msg=str(units)
        )
