"""Ctrl-C in a sweep says what is kept."""

import pytest

import vijax as vx
from vijax._execution.threads import Threads


def stop_at_once(*_):
    raise KeyboardInterrupt


@pytest.mark.parametrize("is_stored", [False, True])
def test_ctrl_c_says_what_is_kept(is_stored, tmp_path, monkeypatch):
    monkeypatch.setattr(Threads, "run", stop_at_once)
    store = str(tmp_path / "store") if is_stored else None
    with pytest.raises(KeyboardInterrupt, match="resumes there") as stopped:
        vx.sweep(vx.models.wagg_bishop_a(0.8), {"forcing.frequency": [0.8, 0.9]}, store=store, progress=False)
    assert ("nothing is kept" in str(stopped.value)) == (not is_stored)
    assert store is None or store in str(stopped.value)
