"""The golden scenes of stops in coordinates y, x = T y: full mass matrices and oblique rows, the same events.

Coordinates at rest and contacts that are never reached fill each machine up to one of two sizes, so that only two
programs are compiled. T mixes all coordinates.
"""

import json

import numpy as np
import pytest
from contact_scenes import contact_machine
from helpers import GOLDEN, golden_names, kinds_at_stops, load_scene, log_of, paired

import vijax as vx

SMALL, LARGE = 4, 6
FAR = 100.0


def _size(name: str) -> int:
    return SMALL if load_scene(name).system.num_masses <= SMALL else LARGE


_MARKS = {SMALL: pytest.mark.thorough, LARGE: pytest.mark.slow}
SCENES = [pytest.param(k, name, marks=_MARKS[_size(name)], id=name) for k, name in enumerate(golden_names())]


def basis_of(seed: int, n: int) -> np.ndarray:
    """Random matrix with singular values between 1/2 and 2."""
    random = np.random.default_rng(seed)
    left, right = (np.linalg.qr(random.normal(size=(n, n)))[0] for _ in range(2))
    return left * random.uniform(0.5, 2.0, n) @ right


def in_coordinates(name: str, basis: np.ndarray) -> vx.ImpactSystem:
    """Machine of a scene, filled up to the size of the basis, in its coordinates."""
    data, size = json.loads((GOLDEN / f"{name}.json").read_text()), len(basis)
    more = size - data["n"]
    matrices = {key: np.eye(size) for key in "MCK"}
    for key, matrix in matrices.items():
        own = np.array(data[key])
        matrix[: data["n"], : data["n"]] = np.diag(own) if own.ndim == 1 else own
    contacts = []
    for stop in data["stops"]:
        sign, position = {"upper": 1.0, "lower": -1.0}[stop["side"]], stop["position"]
        row = sign * np.eye(size)[stop["mass"]]
        contacts.append(
            {"row": row, "position": sign * position, "restitution": stop["restitution"], "motion": None}
        )
    never = {"row": np.eye(size)[-1], "position": FAR, "restitution": 0.5, "motion": None}
    contacts += [never] * (size - len(contacts))
    loads = {key: [*data[key], *[0.0] * more] for key in ("A", "phase")}
    return contact_machine(
        {"Omega": data["Omega"], "contacts": contacts, "mean": np.zeros(size), **matrices, **loads}, basis
    )


@pytest.mark.parametrize(("seed", "name"), SCENES)
def test_a_machine_of_stops_in_other_coordinates_has_the_same_events(seed, name):
    scene, size = load_scene(name), _size(name)
    basis = basis_of(seed, size)
    rest = np.zeros(size - len(scene.x0))
    start = [np.linalg.solve(basis, np.append(a, rest)) for a in (scene.x0, scene.v0)]
    sol = vx.simulate(in_coordinates(name, basis), scene.t0, scene.t1, *start)
    log = log_of(sol)
    assert kinds_at_stops(log) == kinds_at_stops(scene.events)
    for expected, found in paired(scene.events, log):
        if expected.kind != "stick":
            assert abs(found.t - expected.t) <= scene.time_tolerance(expected), (expected, found)
    for found, expected in ((sol.x1, scene.x1), (sol.v1, scene.v1)):
        back = (basis @ found)[: len(expected)]
        np.testing.assert_allclose(back, expected, rtol=0, atol=scene.state_tolerance)
    assert np.flatnonzero(sol.stuck1).tolist() == scene.held_at_end
