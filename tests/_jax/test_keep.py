"""Compiled programs are found again by the next process."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

import vijax as vx
from vijax._jax import compilation_cache, program_store

PROGRAM = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import vijax as vx
hits = []
jax.monitoring.register_event_listener(lambda event, **_: hits.append(event))
jax.jit(lambda x: x + 1)(1.0)  # compiled before anything is kept
vx.keep_compiled(sys.argv[1])
own = jax.jit(lambda x: 3 * x + 1)(1.0)
sol = vx.simulate(vx.models.wagg_bishop_b(0.2), 0.0, 20.0)
print(hits.count("/jax/compilation_cache/cache_hits"), float(sol.x1[0]))
"""


@pytest.mark.slow
def test_the_next_process_finds_what_was_compiled(tmp_path):
    folder, environment = tmp_path / "not there yet", dict(os.environ)
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    found = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(folder)],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        )
        hits, x = done.stdout.split()
        found.append((int(hits), x))
    assert found[0][0] == 0 < found[1][0]
    assert found[0][1] == found[1][1]


def test_without_a_folder_that_of_the_user_is_taken(tmp_path, monkeypatch):
    before = jax.config.jax_compilation_cache_dir
    monkeypatch.setattr(compilation_cache, "user_cache_path", lambda name: tmp_path / name)
    try:
        assert vx.keep_compiled() == tmp_path / "vijax"
        assert jax.config.jax_compilation_cache_dir == str(tmp_path / "vijax")
        assert (tmp_path / "vijax").is_dir()
        assert program_store.program_store().folder == tmp_path / "vijax" / "programs"
    finally:
        vx.keep_compiled(before or tmp_path)
        program_store.store_programs(Path(os.environ["VIJAX_PROGRAMS"]))
