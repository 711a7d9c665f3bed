"""Compiled programs are found by later processes, never for another machine, and no damage to the folder is seen."""

import functools
import gc
import hashlib
import os
import pickle
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vijax._jax import program_store
from vijax._jax.packing import pack
from vijax._jax.program_store import ProgramStore, key_of
from vijax._jax.programs import Programs

PROCESS = """
import sys
import jax
jax.config.update("jax_enable_x64", sys.argv[1] == "64")
import numpy as np
import vijax as vx
from vijax._jax.program_store import ProgramStore

saved, save = [], ProgramStore.save
ProgramStore.save = lambda self, key, *program: (saved.append(key), save(self, key, *program))
{machine}
sol = vx.simulate(system, 0.0, 20.0)
x = [float(sol.x1[0])]
{more}
print(len(saved), *(a.hex() for a in x))
"""
MACHINE = "system = vx.models.wagg_bishop_b(0.2)"


def run_process(folder, *, machine=MACHINE, more="", bits="64") -> tuple[int, list[str]]:
    """Number of programs that a process has stored, and its results."""
    environment = os.environ | {"VIJAX_PROGRAMS": str(folder)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    script = PROCESS.format(machine=machine, more=more)
    done = subprocess.run(
        [sys.executable, "-c", script, bits], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    saved, *x = done.stdout.split()
    return int(saved), x


def programs(folder) -> list:
    return sorted(folder.glob("*.program"))


@pytest.mark.thorough
def test_the_next_process_finds_programs_and_computes_the_same_bits(tmp_path):
    more = """
ds = vx.sweep(system, {"forcing.frequency": np.linspace(0.2, 0.3, 9)}, transient=5, record=2, progress=False)
x += [float(a) for a in ds.x.values.ravel()]
orbit = vx.periodic_orbit(vx.models.impact_oscillator(0.8, restitution=0.8), np.zeros(1), np.zeros(1), throw=False)
x += [float(abs(mu)) for mu in orbit.multipliers]
"""
    first, expected = run_process(tmp_path, more=more)
    assert first == len(programs(tmp_path)) >= 3
    assert run_process(tmp_path, more=more) == (0, expected)


@pytest.mark.slow
def test_damaged_programs_are_made_again(tmp_path):
    first, expected = run_process(tmp_path)
    assert first >= 1
    valid = pickle.dumps("no program")
    for damage in (b"", b"\\0" * 100, hashlib.sha256(valid).digest() + valid, None):
        for file in programs(tmp_path):
            data = file.read_bytes()
            file.write_bytes(data[: len(data) // 2] if damage is None else damage)
        assert run_process(tmp_path) == (first, expected)


@pytest.mark.slow
def test_precision_and_source_are_part_of_the_name(tmp_path):
    first, _ = run_process(tmp_path)
    assert run_process(tmp_path, bits="32")[0] == first
    assert len(programs(tmp_path)) == 2 * first


@pytest.mark.slow
def test_processes_that_begin_at_once_share_a_folder(tmp_path):
    with ThreadPoolExecutor(4) as threads:
        found = [threads.submit(run_process, tmp_path) for _ in range(4)]
    results = {tuple(job.result()[1]) for job in found}
    assert len(results) == 1
    assert not list(tmp_path.glob("*.unfinished"))
    assert run_process(tmp_path)[0] == 0


@pytest.mark.slow
def test_what_depends_on_a_class_of_the_user_has_no_name(tmp_path):
    machine = """
import equinox as eqx
class Law(vx.AbstractRestitution):
    factor: jax.Array
    def __call__(self, speed):
        return self.factor * (1 + 0 * speed)
    def limit(self):
        return self.factor
system = vx.models.wagg_bishop_b(0.2)
"""
    assert run_process(tmp_path, machine=machine)[0] > 0  # the class alone does no harm
    assert key_of(Programs) is not None
    assert key_of(run_process) is None


def plain(number):
    return number


class Own:
    """A class that no release knows."""


@pytest.mark.parametrize("part", [plain, Own, Own(), lambda x: x, functools.partial(plain, 1)])
def test_what_has_no_lasting_name_gives_no_key(part):
    assert key_of("name", (part,)) is None


def test_equal_parts_have_equal_keys_and_others_do_not():
    layouts = [pack({"a": np.zeros(size), "b": (1.5, "word")}).layout for size in (3, 3, 4)]
    first, again, other = (key_of("name", layout) for layout in layouts)
    assert first == again != other
    word = "".join(["wo", "rd"])
    assert key_of("word", word) == key_of(word, "word")  # one object or two
    assert key_of(1) != key_of(1.0) != key_of(True)
    of_trees = [key_of(jax.tree.structure(tree)) for tree in ((1, 2), [1, 2], {"a": 1, "b": 2})]
    assert None not in of_trees
    assert len(set(of_trees)) == 3


def programs_in(folder, monkeypatch, function, name="double") -> Programs:
    monkeypatch.setattr(program_store._active, "is_chosen", True)
    monkeypatch.setattr(program_store._active, "store", ProgramStore(folder))
    return Programs(function, lambda: None, name=name)


@pytest.mark.usefixtures("no_other_cache")
def test_a_stored_program_is_used_without_a_trace(tmp_path, monkeypatch):
    traces = []

    def double(tree, factor):
        traces.append(factor)
        return {"twice": 2 * tree["x"], "factor": factor, "none": None}

    x = np.arange(3.0)
    for _ in range(2):
        found = programs_in(tmp_path, monkeypatch, double)({"x": x}, "word")
        np.testing.assert_array_equal(found["twice"], 2 * x)
        assert (found["factor"], found["none"]) == ("word", None)
    assert traces == ["word"]


@pytest.mark.usefixtures("no_other_cache")
def test_a_function_without_a_name_is_stored_by_its_text(tmp_path, monkeypatch):
    def product(factor):
        return lambda x, word: {"product": factor * x, "word": word}

    numbers = []
    for factor, word in [(2, "first"), (2, "again"), (3, "other")]:
        found = programs_in(tmp_path, monkeypatch, product(factor), name=None)(np.arange(3.0), word)
        np.testing.assert_array_equal(found["product"], factor * np.arange(3.0))
        assert found["word"] == word
        numbers.append(len(programs(tmp_path)))
    assert numbers == [1, 1, 2]


@pytest.mark.usefixtures("no_other_cache")
def test_functions_of_one_text_that_read_other_arguments_are_told_apart(tmp_path, monkeypatch):
    functions = [(lambda a, b: 2 * a, 2.0), (lambda a, b: 2 * b, 4.0), (lambda *a: 2 * a[0], 2.0)]
    x, y = np.array([1.0]), np.array([2.0])
    for function, expected in functions:
        twice = programs_in(tmp_path, monkeypatch, function, name=None)
        assert twice(x, y) == expected
    assert programs_in(tmp_path, monkeypatch, functions[-1][0], name=None)(x) == 2.0


@pytest.mark.usefixtures("no_other_cache")
def test_donated_arrays_are_used_up_by_a_stored_program_too(tmp_path, monkeypatch):
    for _ in range(2):
        monkeypatch.setattr(program_store._active, "is_chosen", True)
        monkeypatch.setattr(program_store._active, "store", ProgramStore(tmp_path))
        add = Programs(lambda a, b: a + b, lambda: None, name="add", donates_last=True)
        given = jnp.arange(4.0)
        np.testing.assert_array_equal(add(np.ones(4), given), [1, 2, 3, 4])
        assert given.is_deleted()


@pytest.mark.usefixtures("no_other_cache")
def test_linear_algebra_of_a_stored_program(tmp_path, monkeypatch):
    matrix = np.array([[2.0, 1.0], [1.0, 3.0]])
    for _ in range(2):
        solve = programs_in(tmp_path, monkeypatch, jnp.linalg.inv, name="inverse")
        np.testing.assert_allclose(solve(matrix) @ matrix, np.eye(2), atol=1e-15)
    assert len(programs(tmp_path)) == 1


@pytest.mark.usefixtures("no_other_cache")
def test_what_calls_back_into_python_is_not_stored(tmp_path, monkeypatch):
    heard = []

    def loud(x):
        jax.debug.callback(heard.append, x)
        return x

    programs_in(tmp_path, monkeypatch, loud)(np.ones(2))
    jax.effects_barrier()
    assert len(heard) == 1
    assert not programs(tmp_path)


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    double = programs_in(tmp_path / "file" / "folder", monkeypatch, lambda x: 2 * x)
    np.testing.assert_array_equal(double(np.ones(2)), [2, 2])


@pytest.mark.usefixtures("no_other_cache")
def test_programs_not_used_for_longest_are_removed_first(tmp_path, monkeypatch):
    double = programs_in(tmp_path, monkeypatch, lambda x: 2 * x)
    double(np.ones(1))
    size = programs(tmp_path)[0].stat().st_size
    monkeypatch.setattr(program_store, "_MOST", 3.5 * size)
    monkeypatch.setattr(program_store, "_AFTER", 2.5 * size)
    first = programs(tmp_path)[0]
    for k in (2, 3):
        os.utime(first, (k, k))
        double(np.ones(k))
    os.utime(first)
    newest = set(programs(tmp_path)) - {first}
    for k, file in enumerate(sorted(newest)):
        os.utime(file, (k, k))
    double(np.ones(4))
    left = programs(tmp_path)
    assert first in left
    assert len(left) == 2


def test_the_environment_turns_storing_off(monkeypatch):
    monkeypatch.setattr(program_store, "_active", program_store._Active())
    monkeypatch.setenv("VIJAX_PROGRAMS", "off")
    assert program_store.program_store() is None


def test_programs_that_were_dropped_are_made_again(tmp_path, monkeypatch):
    double = programs_in(tmp_path, monkeypatch, lambda x: 2 * x)
    double(np.ones(2))
    double.drop()
    assert double.count() == 0
    np.testing.assert_array_equal(double(np.ones(2)), [2, 2])


def test_prepared_calls_keep_no_program_that_is_dropped(tmp_path, monkeypatch):
    double = programs_in(tmp_path, monkeypatch, lambda x: 2 * x)
    call, ones = double.prepared(np.ones(2)), [np.ones(2)]
    call(ones)
    (run,) = (weakref.ref(run) for run, _ in double._made.values())
    double.drop()
    gc.collect()
    assert run() is None
    np.testing.assert_array_equal(call(ones), [2, 2])


def test_a_folder_in_which_all_can_write_is_not_used(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(program_store, "_active", program_store._Active())
    tmp_path.chmod(0o777)
    program_store.store_programs(tmp_path)
    assert program_store.program_store() is None
    assert "choose a private folder" in caplog.text
    tmp_path.chmod(0o700)
    program_store.store_programs(tmp_path)
    assert program_store.program_store() is not None


def test_transformations_see_the_function(tmp_path, monkeypatch):
    double = programs_in(tmp_path, monkeypatch, lambda x: 2 * x)
    np.testing.assert_array_equal(jax.vmap(double)(jnp.arange(3.0)), [0, 2, 4])
    assert jax.grad(double)(1.5) == 2.0
    assert jax.jit(double)(1.5) == 3.0
