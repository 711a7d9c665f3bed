"""Attractors of symmetric machines with their mirror images as one, against all of them."""

import numpy as np
import pytest

import vijax as vx
from vijax._attractors.attractors import machines_of_one
from vijax._attractors.images import first_images
from vijax._execution.settings import DEFAULT_SETTINGS

pytestmark = pytest.mark.thorough


def between_stops(frequency: float, lower: float = -0.5) -> vx.ImpactSystem:
    """A mass between two stops: if these are equal its motion is symmetric at 2, and has lost the symmetry at 1.5."""
    stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, lower, "lower", 0.8)]
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], frequency), stops)


def two_alike() -> vx.ImpactSystem:
    """Two masses that may change places, with a stop each."""
    stops = [vx.Stop(i, 0.3, "upper", 0.8) for i in range(2)]
    stiffness = [[1.2, -0.2], [-0.2, 1.2]]
    return vx.ImpactSystem([1.0, 1.0], 0.05 * np.eye(2), stiffness, vx.Harmonic([0.5, 0.5], 2.7), stops)


def test_a_pair_of_images_is_one_attractor_of_two_images():
    plain, folded = (
        vx.attractors(between_stops(1.5), 40, transient=300, fold=fold, progress=False)
        for fold in (False, True)
    )
    assert plain.sizes["attractor"] == 2
    assert "num_images" not in plain
    assert folded.sizes["attractor"] == 1
    assert folded.num_images.values.tolist() == [2]
    assert float(folded.share[0]) == pytest.approx(float(plain.share.sum()))
    np.testing.assert_array_equal(folded.x0[0], plain.x0[0])
    np.testing.assert_array_equal(folded.label, np.minimum(plain.label, 0))


@pytest.mark.parametrize(("frequency", "lower"), [(2.0, -0.5), (1.5, -0.6)])
def test_symmetric_motions_and_those_of_other_machines_are_their_only_image(frequency: float, lower: float):
    plain, folded = (
        vx.attractors(between_stops(frequency, lower), 40, transient=300, fold=fold, progress=False)
        for fold in (False, True)
    )
    assert (folded.num_images == 1).all()
    np.testing.assert_array_equal(folded.label, plain.label)


@pytest.mark.slow
def test_half_of_a_symmetric_grid_is_run():
    machine = two_alike()
    values = np.linspace(-0.5, 0.29, 12)
    grid = {"x0[0]": values, "x0[1]": values}
    plain, folded = (vx.basins(machine, grid, fold=fold, progress=False) for fold in (False, True))
    # Two attractors are folded into one exactly where their starts are those with the masses in each other's place.
    swapped = plain.label.values.T
    for here, there in zip(plain.label.values.ravel(), swapped.ravel(), strict=True):
        assert set(folded.label.values[plain.label.values == here]) == set(
            folded.label.values[plain.label.values == there]
        )
    np.testing.assert_array_equal(folded.label, folded.label.T)
    assert int(folded.num_starts.sum()) == int(plain.num_starts.sum())


def test_starts_with_an_image_among_them_are_run_once():
    machine = two_alike()
    machines = machines_of_one("attractors", machine, None, 10, 2, None, None, None, DEFAULT_SETTINGS, None)
    rng = np.random.default_rng(3)
    states = rng.normal(size=(50, 4))
    both = np.concatenate([states, states[:20][:, [1, 0, 3, 2]]])
    first, image = first_images(machines, both)
    assert len(first) == 50
    same = both[first][image]
    is_image = np.abs(same - both).max(axis=1) > 0
    np.testing.assert_array_equal(same[is_image], both[is_image][:, [1, 0, 3, 2]])
    assert is_image.sum() == 20
