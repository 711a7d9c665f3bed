"""Measures of basins, against closed forms for basins drawn by hand, and critical shocks against runs of each start."""

import numpy as np
import pytest
import xarray as xr

import vijax as vx

X, V = "x0[0]", "v0[0]"
# Cells of the grids along each side.
SIZE = 101


def drawn(label, points=((0.0, 0.0),), size=SIZE, half=(1.0, 2.0)) -> xr.Dataset:
    """Basins with a label that is a function of x and v, and an attractor at each point."""
    x, v = (np.linspace(-a, a, size) for a in half)
    labels = np.asarray(label(x[:, None], v[None]) + 0 * (x[:, None] + v[None]), int)
    section = np.array(points, float)[:, None, :]
    variables = {
        "label": ((X, V), labels),
        "section_x": (("attractor", "section", "mass"), section[..., :1]),
        "section_v": (("attractor", "section", "mass"), section[..., 1:]),
    }
    return xr.Dataset(variables, {X: x, V: v})


def within(found: xr.Dataset, name: str, exact: float, number: int = 0) -> bool:
    """True if a radius agrees with the exact one within the error that it tells, and this is that of some cells."""
    radius, error = float(found[name][number]), float(found[f"{name}_error"][number])
    return abs(radius - exact) <= error + 1e-12 and error < 0.03


def disc(x, v):
    return x**2 + (v / 2) ** 2 > 0.36


def test_a_disc_has_the_radius_of_the_disc_about_its_middle_and_less_beside_it():
    unit = {X: 1.0, V: 2.0}
    found = vx.integrity(drawn(disc, ((0.0, 0.0), (0.9, 1.8))), scale=unit)
    assert within(found, "local_integrity", 0.6)
    assert within(found, "integrity_factor", 0.6)
    np.testing.assert_allclose(found.center[0], 0, atol=0.05)
    assert float(found.share[0]) == pytest.approx(np.pi * 0.36 / 4, rel=0.03)
    beside = vx.integrity(drawn(disc, ((0.25, 0.0), (0.9, 1.8))), scale=unit)
    assert within(beside, "local_integrity", 0.35)
    # Around the other attractor the edges of the window come first.
    assert within(found, "local_integrity", 0.1, 1)
    # In the corner of the square the circle between its two edges and the disc.
    assert within(found, "integrity_factor", (np.sqrt(2) - 0.6) / (np.sqrt(2) + 1), 1)


def test_radii_count_in_widths_of_the_window_unless_a_scale_is_given():
    half_plane = drawn(lambda x, v: x > 0.3, ((-0.2, 0.0), (0.5, 0.0)))
    found = vx.integrity(half_plane)
    assert within(found, "local_integrity", 0.25)
    assert within(found, "integrity_factor", 0.65 / 2)
    in_units = vx.integrity(half_plane, scale={X: 1.0, V: 1.0})
    assert abs(float(in_units.local_integrity[0]) - 0.5) <= float(in_units.local_integrity_error[0])
    # Reversed and exchanged axes describe the same basins.
    turned = vx.integrity(half_plane.isel({X: slice(None, None, -1)}).transpose(V, X, ...))
    np.testing.assert_allclose(turned.local_integrity, found.local_integrity)
    np.testing.assert_allclose(turned.center.sel(quantity=X), found.center.sel(quantity=X))


def test_a_window_that_ends_at_a_stop_ends_no_ball_there():
    stops = [vx.Stop(0, -1.0, "lower", 0.5), vx.Stop(0, 1.0, "upper", 0.5)]
    system = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 2.0), stops)
    grid = {"forcing.frequency": [2.0]}
    attributes = vx.sweep(system, grid, transient=0, record=1, progress=False).attrs
    basins = drawn(lambda x, v: x > 0.3, ((-0.9, 0.0), (0.5, 0.0))).assign_attrs(attributes)
    assert within(vx.integrity(basins), "local_integrity", 0.5)  # by the edges of velocity
    assert within(vx.integrity(basins, scale={X: 1.0, V: 8.0}), "local_integrity", 0.25)
    assert within(vx.integrity(basins, scale={X: 2.0, V: 1.0}), "local_integrity", 0.6)


def test_what_no_window_shows_is_unknown():
    outside = vx.integrity(drawn(lambda x, v: x > 0, ((-0.5, 0.0), (1.5, 0.0))))
    assert np.isfinite(outside.local_integrity[0])
    assert np.isnan(outside.local_integrity[1])
    unknown = vx.integrity(drawn(lambda x, v: np.where(x > 0, -1, 0)))
    assert within(unknown, "local_integrity", 0.0)
    assert float(unknown.share[0]) == pytest.approx(51 / 101)
    line = drawn(disc, ((0.0, 0.0), (0.9, 1.8))).isel({V: 50}, drop=True)
    assert np.isnan(vx.integrity(line).local_integrity).all()


def test_the_entropy_of_a_checkerboard_is_log_2_and_of_half_planes_that_of_their_boundary():
    checkers = drawn(lambda x, v: np.indices((SIZE, SIZE)).sum(axis=0) % 2, ((0.0, 0.0), (0.1, 0.0)))
    found = vx.integrity(checkers, box=4)
    assert float(found.basin_entropy) == pytest.approx(np.log(2), abs=1e-12)
    assert float(found.boundary_basin_entropy) == pytest.approx(np.log(2), abs=1e-12)
    # 52 of 101 columns are right of -0.03; a fifth of the boxes of 5 would be cut at 2 of their columns.
    half = drawn(lambda x, v: x > -0.03, ((-0.5, 0.0), (0.5, 0.0)))
    found = vx.integrity(half)
    cut = -(0.8 * np.log(0.8) + 0.2 * np.log(0.2))
    assert float(found.boundary_basin_entropy) == pytest.approx(cut, abs=1e-12)
    assert float(found.basin_entropy) == pytest.approx(cut / 20, abs=1e-12)
    alone = vx.integrity(drawn(lambda x, v: 0))
    assert float(alone.basin_entropy) == 0
    assert np.isnan(alone.boundary_basin_entropy)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"box": 1}, "`box`"),
        ({"box": 200}, "at most 101"),
        ({"scale": {"x": 1.0}}, "for `x`"),
        ({"scale": {X: 0.0}}, "positive length"),
    ],
)
def test_wrong_arguments_are_refused(options, said):
    with pytest.raises(ValueError, match=said):
        vx.integrity(drawn(disc), **options)
    with pytest.raises(ValueError, match="no `label`"):
        vx.integrity(xr.Dataset())
