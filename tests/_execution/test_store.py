"""A sweep that is stopped, killed or damaged on disk resumes, and returns the same, bit for bit."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray as xr

import vijax as vx
from vijax._execution import store as stores
from vijax._execution.runner import Counts
from vijax._execution.settings import ExecutionSettings
from vijax._execution.threads import Threads

FREQUENCY = "forcing.frequency"
# Case (b) chatters and sticks at the first, and is chaotic at the last.
FREQUENCIES = np.linspace(0.2, 2.1, 24)
# Points of the carried sweep, which run one after another.
CARRIED = np.linspace(0.2, 2.1, 8)
SYSTEM = vx.models.wagg_bishop_b(1.0)
# Chunks of the 24 points: 5, 5, 5, 5, 4.
POINTS_PER_CHUNK, NUM_CHUNKS = 5, 5
SMALL_CHUNKS = ExecutionSettings(cores=1, max_chunk=POINTS_PER_CHUNK, visits=2)


def sweep(store: Path | None = None, system: vx.ImpactSystem = SYSTEM, values=None, **options) -> xr.Dataset:
    """A short sweep, long enough for chaos to reveal the last bit."""
    if values is None:
        values = {FREQUENCY: FREQUENCIES if options.get("carry") is None else CARRIED}
    options = {"transient": 10, "record": 5, "progress": False, "settings": SMALL_CHUNKS} | options
    return vx.sweep(system, values, store=store, **options)


@pytest.fixture
def ran(monkeypatch) -> list[int]:
    """Numbers of points of all runs that the store did not answer."""
    numbers = []
    original = Threads.run

    def counted(self, points, which, tell):
        numbers.append(len(which))
        return original(self, points, which, tell)

    monkeypatch.setattr(Threads, "run", counted)
    return numbers


@pytest.fixture(scope="module")
def plain() -> dict[str | None, xr.Dataset]:
    """Sweeps without a store."""
    return {carry: sweep(carry=carry) for carry in (None, "up")}


def assert_same(found: xr.Dataset, expected: xr.Dataset):
    """Compare every bit and every attribute except the number of steps of idle lanes."""
    for ds in (found, expected):
        ds.steps.attrs.pop("lane_steps", None)
    xr.testing.assert_identical(found, expected)
    for name, variable in expected.variables.items():
        assert found[name].dtype == variable.dtype


def stop_at_chunk(number: int, monkeypatch, stop) -> None:
    """Call `stop` when the chunk of this number is written, but not yet renamed."""
    replace, written = os.replace, []

    def replace_or_stop(part, file):
        written.append(file)
        if sum(str(f).endswith(".npz") for f in written) == number:
            stop()
        replace(part, file)

    monkeypatch.setattr(stores.os, "replace", replace_or_stop)


def chunks_of(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.npz"))


@pytest.mark.parametrize("carry", [None, "up"])
def test_a_store_changes_nothing(plain, tmp_path, ran, carry):
    first = sweep(tmp_path / "a", carry=carry)
    assert max(ran) <= POINTS_PER_CHUNK
    assert first.result.max() == 0
    assert first.num_sticks.sum() > 0
    assert_same(first, plain[carry])
    ran.clear()
    again = sweep(tmp_path / "a", carry=carry)
    assert ran == []
    assert_same(again, plain[carry])


def test_the_size_of_the_chunks_changes_nothing(plain, tmp_path, ran):
    assert_same(sweep(tmp_path, settings=ExecutionSettings(cores=1, max_chunk=7)), plain[None])
    assert ran == [6, 6, 6, 6]


@pytest.fixture
def interruptible():
    """Make interrupts raise, even if pytest runs in the background, which ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("carry", [None, "up"])
def test_an_interrupted_sweep_goes_on_where_it_stopped(plain, tmp_path, ran, carry):
    whole = sweep(tmp_path / "whole", carry=carry)
    num_runs = len(ran)
    with pytest.MonkeyPatch.context() as patch:
        stop_at_chunk(4, patch, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path / "cut", carry=carry)
    assert len(chunks_of(tmp_path / "cut")) == 3
    ran.clear()
    resumed = sweep(tmp_path / "cut", carry=carry)
    assert len(ran) == num_runs - 3
    xr.testing.assert_identical(resumed, whole)
    assert_same(resumed, plain[carry])


CHILD = """
import os, signal, sys
import jax, pytest
sys.path.insert(0, sys.argv[1])
jax.config.update("jax_enable_x64", True)
if sys.argv[3] != "None":
    jax.config.update("jax_compilation_cache_dir", sys.argv[3])
import test_store
test_store.stop_at_chunk(3, pytest.MonkeyPatch(), lambda: os.kill(os.getpid(), signal.SIGKILL))
test_store.sweep(sys.argv[2])
"""


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_a_killed_sweep_loses_one_chunk(plain, tmp_path, ran):
    arguments = [str(Path(__file__).parent), str(tmp_path / "a"), str(jax.config.jax_compilation_cache_dir)]
    child = subprocess.run([sys.executable, "-c", CHILD, *arguments], capture_output=True, text=True)
    assert child.returncode == -signal.SIGKILL, child.stderr
    assert len(chunks_of(tmp_path / "a")) == 2
    assert_same(sweep(tmp_path / "a"), plain[None])
    assert len(ran) == NUM_CHUNKS - 2


def flip(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


DAMAGES = {
    "cut in half": lambda data: data[: len(data) // 2],
    "empty": lambda data: b"",
    "last byte missing": lambda data: data[:-1],
    "a flipped bit at the beginning": lambda data: flip(data, 30),
    "a flipped bit in the middle": lambda data: flip(data, len(data) // 2),
    "a flipped bit at the end": lambda data: flip(data, len(data) - 1),
    "of something else": lambda data: b"\0" * len(data),
}


@pytest.fixture(scope="module")
def full(tmp_path_factory) -> Path:
    """A store with all chunks."""
    folder = tmp_path_factory.mktemp("full")
    sweep(folder)
    return folder


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_chunk_is_made_again(plain, full, ran, damage):
    chunk = chunks_of(full)[2]
    sound = chunk.read_bytes()
    chunk.write_bytes(DAMAGES[damage](sound))
    assert_same(sweep(full), plain[None])
    assert len(ran) == 1
    assert chunk.read_bytes() == sound


def test_a_chunk_of_another_name_is_made_again(plain, full, ran):
    first, second = chunks_of(full)[:2]
    first.write_bytes(second.read_bytes())
    assert_same(sweep(full), plain[None])
    assert len(ran) == 1


def test_a_chunk_of_another_sweep_is_made_again(plain, full, tmp_path, ran):
    """Files of the same points have the same names after another transient."""
    sweep(tmp_path, transient=1)
    ran.clear()
    files = [(chunk, tmp_path / chunk.name) for chunk in chunks_of(full)]
    for chunk, other in files:
        chunk.write_bytes(other.read_bytes())
    assert_same(sweep(full), plain[None])
    assert len(ran) == NUM_CHUNKS


def test_a_chunk_is_a_file_that_numpy_reads(full):
    with np.load(chunks_of(full)[0]) as arrays:
        assert arrays["x"].shape[0] == SYSTEM.num_masses


def test_the_number_of_the_layout_stands_for_what_a_chunk_holds(full):
    """If this fails, a change of `Found` made old stores unreadable: increase `_LAYOUT`."""
    with np.load(chunks_of(full)[0]) as arrays:
        layout = {name: a.shape[:-1] for name, a in arrays.items()}
        columns = {name: a.dtype.kind for name, a in arrays.items() if name.startswith("impacts.")}
    assert stores._LAYOUT == 5
    assert columns == {
        "impacts.time": "f",
        "impacts.velocity": "f",
        "impacts.chatter": "f",
        "impacts.stop": "i",
        "impacts.point": "i",
        "impacts.number": "i",
    }
    assert layout == dict.fromkeys(columns, ()) | {
        "lane_steps": (),
        "section_x": (SYSTEM.num_masses, 5),
        "section_v": (SYSTEM.num_masses, 5),
        "section_held_time": (SYSTEM.num_stops, 5),
        "x": (2,),
        "v": (2,),
        "held": (2,),
        "periods": (),
        "num_impacts": (2,),
        "num_sticks": (2,),
        "steps": (),
        "is_finite": (),
    }


MOVED = vx.models.wagg_bishop_b(1.0, 0.4)
OTHERS = {
    "machine": ({"system": MOVED}, "`system.forcing.amplitude[0]` is 0.5 there, but 0.4 here"),
    "values": ({"values": {FREQUENCY: FREQUENCIES[:-1]}}, "`values.forcing.frequency` is 24 values from 0.2"),
    "one value": ({"values": {FREQUENCY: np.append(FREQUENCIES[:-1], 2.0)}}, "24 values from 0.2 to 2.0 ("),
    "path": ({"values": {"forcing.phase[0]": FREQUENCIES}}, "but missing here"),
    "transient": ({"transient": 11}, "`transient` is 10 there, but 11 here"),
    "record": ({"record": 6}, "`record` is 5 there, but 6 here"),
    "carry": ({"carry": "up"}, "`carry` is none there, but up here"),
    "start": ({"x0": [0.1, 0.0]}, "`x0` is [0.0, 0.0] there, but [0.1, 0.0] here"),
    "speed": ({"v0": [0.0, 0.1]}, "`v0` is [0.0, 0.0] there, but [0.0, 0.1] here"),
    "room": ({"max_impacts": 100}, "`max_impacts` is 2048 there, but 100 here"),
    "bound": ({"max_steps": 1000}, "`max_steps` is default there, but 1000 here"),
    "settings": (
        {"settings": ExecutionSettings(lanes=48)},
        "`settings.lanes` is 80 there, but 48 here",
    ),
    "flow": ({"flow": vx.TaylorFlow()}, "`flow` is ModalFlow there, but TaylorFlow() here"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_store_of_another_sweep_is_refused(full, what):
    options, sentence = OTHERS[what]
    with pytest.raises(ValueError, match=re.escape(sentence)) as refusal:
        sweep(full, **options)
    assert str(refusal.value).startswith(f"The store {full} holds another sweep: ")


def test_going_on_from_other_ends_is_refused(plain, tmp_path, ran):
    sweep(tmp_path, carry_from=plain[None])
    with pytest.raises(ValueError, match="`starts` is"):
        sweep(tmp_path, carry_from=sweep(transient=9))
    with pytest.raises(ValueError, match="`carry_from` is an earlier sweep there, but none here"):
        sweep(tmp_path)


def test_a_store_of_other_versions_is_refused(full, monkeypatch):
    monkeypatch.setattr(stores, "_LAYOUT", 6)
    with pytest.raises(ValueError, match="`layout` is 5 there, but 6 here"):
        sweep(full)
    monkeypatch.setattr(stores, "_LAYOUT", 5)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with pytest.raises(ValueError, match="`device` is cpu there, but gpu here"):
        sweep(full)


def test_a_folder_that_holds_something_else_is_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("Dear sir")
    for path in (tmp_path, tmp_path / "letter.txt"):
        with pytest.raises(ValueError, match="`store` must name a new or empty folder"):
            sweep(path)
    assert [file.name for file in tmp_path.iterdir()] == ["letter.txt"]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", json.dumps({"sweep": {}}), json.dumps({"points_per_chunk": 5})]
)
def test_a_damaged_manifest_is_refused(tmp_path, text):
    (tmp_path / "sweep.json").write_text(text)
    with pytest.raises(ValueError, match="is damaged: delete the folder"):
        sweep(tmp_path)


@pytest.fixture
def largest_file() -> Iterator[Callable[[int], None]]:
    """Limit on the size of files, which stands for the end of the disk."""
    resource = pytest.importorskip("resource", reason="the system has no limits")
    kind = resource.RLIMIT_FSIZE
    limits = resource.getrlimit(kind)
    yield lambda size: resource.setrlimit(kind, (size, limits[1]) if size else limits)
    resource.setrlimit(kind, limits)


@pytest.mark.parametrize(("argument", "size"), [("store", 3000), ("out", 500)])
def test_a_disk_that_fills_up_is_told_and_what_is_done_is_kept(
    plain, tmp_path, monkeypatch, largest_file, argument, size
):
    if argument == "out":
        pytest.importorskip("zarr", reason="the extra `io` is not installed")
    place, begun, original = {argument: tmp_path / "place"}, [], Threads.run

    def fill(self, *rest):
        begun.append(True)
        if len(begun) == 2:
            largest_file(size)
        return original(self, *rest)

    monkeypatch.setattr(Threads, "run", fill)
    with pytest.raises(OSError, match="What is done is kept there: make room"):
        sweep(**place)
    largest_file(0)
    assert not list((tmp_path / "place").glob("*.part"))
    found = sweep(**place).load()
    for name in found.data_vars:
        if name != "steps" and "impact" not in found[name].dims:
            np.testing.assert_array_equal(found[name].values, plain[None][name].values, err_msg=str(name))


def test_an_interrupted_write_of_the_manifest_is_no_obstacle(plain, tmp_path, ran):
    for name in ("sweep.part", "sweep.0123abcd.part"):
        (tmp_path / name).write_text("{")
    assert_same(sweep(tmp_path), plain[None])


def test_the_progress_bar_counts_what_was_restored(full, capsys):
    chunks_of(full)[0].unlink()
    sweep(full, progress=True)
    assert "24/24" in capsys.readouterr().err


NOTEBOOK = """
import sys, types, warnings
warnings.simplefilter("error")
kernel = types.SimpleNamespace(config={"IPKernelApp": {}})
sys.modules |= {"IPython": types.SimpleNamespace(get_ipython=lambda: kernel), "ipywidgets": None}
from vijax._progress import tqdm
with tqdm(total=2) as bar:
    bar.update(2)
"""


def test_a_notebook_that_has_no_widgets_shows_a_line_of_text_and_no_warning():
    child = subprocess.run([sys.executable, "-c", NOTEBOOK], capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    assert "2/2" in child.stderr
    assert "Warning" not in child.stderr


def test_a_chunk_is_the_work_of_seconds(tmp_path):
    settings, sizes = ExecutionSettings(cores=1), []
    runner = Threads(vx.TaylorFlow(), Counts(0, 0, 0, None, can_stick=True), settings)
    for periods in (10, 10**4, 10**7):
        made = {"transient": 0, "record": periods}
        store = stores.open_store(tmp_path / str(periods), made, runner, settings, periods)
        sizes.append(store.points_per_chunk)
    assert sizes[0] == settings.points
    assert sizes[0] > sizes[1] >= sizes[2] >= settings.lanes
