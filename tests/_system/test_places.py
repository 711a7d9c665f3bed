"""Paths that cannot be written to raise an error that names the argument, before anything is computed."""

import pytest

import vijax as vx

SYSTEM = vx.models.wagg_bishop_b(0.8)
VALUES = {"forcing.frequency": [0.8, 0.9]}


def swept(**where):
    return vx.sweep(SYSTEM, VALUES, transient=1, record=1, progress=False, **where)


DOORS = {
    "file": lambda place: vx.save(SYSTEM, place.with_suffix(".toml")),
    "store": lambda place: swept(store=place),
    "out": lambda place: swept(out=place),
    "folder": vx.keep_compiled,
}


@pytest.mark.parametrize("name", DOORS)
def test_a_place_below_a_file_is_told(tmp_path, name):
    if name == "out":
        pytest.importorskip("zarr")
    (tmp_path / "taken").write_text("")
    with pytest.raises(
        ValueError,
        match=rf"Argument `{name}` must name a place that can be written to, but '.*taken.*' is none: ",
    ):
        DOORS[name](tmp_path / "taken" / "kept")
    assert [file.name for file in tmp_path.iterdir()] == ["taken"]


def test_a_film_in_a_folder_that_is_not_there_is_told(tmp_path):
    sol = vx.simulate(SYSTEM, 0.0, 1.0, max_events=64)
    with pytest.raises(ValueError, match="Argument `file` must name a place that can be written to"):
        vx.plot.animate(sol, file=tmp_path / "nowhere" / "film.html", duration=0.1, fps=10)
