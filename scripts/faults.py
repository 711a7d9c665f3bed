"""Disturb sweeps and compiled programs while they are written, and check that nothing is lost or wrong.

    python scripts/faults.py --kills 1000 --out out/faults

Processes are killed at random moments, workers of executors as well; files of programs are damaged; disks are full, memory ends. Each time the
work is begun again in the same folder, until it ends; then its results are those of undisturbed work, bit for bit. A process that
is not killed may fail, with a sentence. A case that is done is a line of `tally.jsonl` in the folder: the same command goes on where it was
stopped. `--case K` repeats one, as far as the moments of kills can be repeated.
"""

import argparse
import contextlib
import json
import os
import pickle
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

VICTIMS = Path(__file__).with_name("fault_victims.py")
# Seconds after which an undisturbed process is taken to hang, and most attempts to end one piece of work.
HANGS, ATTEMPTS = 300.0, 20
# Attempts under a limit of the disk or the memory, which work may never meet.
LIMITED = 4
# What is done to which work. Kinds that appear more often are played more often.
CASES = (
    ("store", "kill"),
    ("zarr", "kill"),
    ("programs", "kill"),
    ("store", "kill"),
    ("zarr", "kill"),
    ("processes", "kill a worker"),
    ("dask", "kill a worker"),
    ("mpi", "kill a worker"),
    ("programs", "damage"),
    ("programs", "ten at once"),
    ("store", "full"),
    ("zarr", "full"),
    ("programs", "full"),
    ("store", "memory"),
    ("zarr", "memory"),
)


class Broken(Exception):
    """Something is lost or wrong; the message says what."""


class Case:
    """Work of one kind in a folder, and what was done to it."""

    def __init__(self, kind: str, folder: Path, rng: random.Random):
        self.kind, self.folder, self.rng = kind, folder, rng
        self.kills = self.sentences = 0
        self.said = ""

    def begin(self, limit: Callable[[], None] | None = None) -> subprocess.Popen:
        """Start the work; a limit is set in its process before it begins."""
        python = [sys.executable]
        if self.kind == "mpi":
            python = [
                str(Path(sys.executable).with_name("mpiexec")),
                "-n",
                "2",
                sys.executable,
                "-m",
                "mpi4py.futures",
            ]
        return subprocess.Popen(
            [*python, str(VICTIMS), self.kind, str(self.folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,  # a file would be cut where the disk is full
            text=True,
            preexec_fn=limit,
            start_new_session=True,
        )

    def end(self, process: subprocess.Popen) -> bool:
        """Wait for the work; True if it is done, False if it failed with a sentence or was killed."""
        try:
            _, self.said = process.communicate(timeout=HANGS)
        except subprocess.TimeoutExpired:
            kill_all(process)
            raise Broken("hangs") from None
        kill_all(process)  # what a killed process left
        if process.returncode == 0:
            return True
        if process.returncode == -signal.SIGKILL or (self.kind == "mpi" and self.kills):
            return False  # MPI ends all ranks
        if not says_a_sentence(self.said):
            raise Broken(f"ended with {process.returncode}: {self.said[-600:]}")
        self.sentences += 1
        return False

    def result(self) -> dict[str, np.ndarray]:
        """What the work has found."""
        return pickle.loads((self.folder / "result").read_bytes())

    def finish(self, disturb: Callable[[], bool], attempts: int) -> dict[str, np.ndarray]:
        """Disturb the work until it is done; undisturbed at last, and once more, with all of it known."""
        for _ in range(attempts):
            if disturb():
                break
        for _ in range(2):
            if not self.end(self.begin()):
                raise Broken(f"undisturbed work failed: {self.said[-600:]}")
        return self.result()


def kill_all(process: subprocess.Popen) -> None:
    """Kill a process and all that it has started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def says_a_sentence(said: str) -> bool:
    """True if a process ended with an exception that tells what happened: a last line `Error: Text.`."""
    lines = [line for line in said.splitlines() if line.strip()]
    return any(": " in line and "Error" in line.split(": ")[0] for line in lines[-40:])


def kill(case: Case, whole: float) -> bool:
    """Kill the process at a random moment of its work."""
    process = case.begin()
    assert process.stdout is not None
    process.stdout.readline()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(timeout=case.rng.uniform(0, whole / 2))
    if process.poll() is None:
        case.kills += 1
        kill_all(process)
    return case.end(process)


def kill_worker(case: Case, whole: float) -> bool:
    """Kill workers of the process, each at a random moment."""
    process = case.begin()
    assert process.stdout is not None
    lines = iter(process.stdout.readline, "")
    for line in lines:
        if "working" in line:
            break
    is_over = threading.Event()

    def disturb() -> None:
        while not is_over.wait(case.rng.uniform(0.05, whole / 3)):
            workers = workers_of(process.pid)
            if workers and process.poll() is None:
                with contextlib.suppress(psutil.NoSuchProcess):
                    case.rng.choice(workers).kill()
                    case.kills += 1

    killer = threading.Thread(target=disturb)
    killer.start()
    try:
        return case.end(process)
    finally:
        is_over.set()
        killer.join()


def workers_of(pid: int) -> list[psutil.Process]:
    """Processes of Python that a process has started, without helpers of its libraries."""
    try:
        found = psutil.Process(pid).children(recursive=True)
        return [
            p
            for p in found
            if "resource_tracker" not in (words := " ".join(p.cmdline())) and "python" in words
        ]
    except psutil.NoSuchProcess:
        return []


def damage(case: Case, _: float) -> bool:
    """Damage files of a finished folder at random, and work again."""
    if not case.end(case.begin()):
        raise Broken("undisturbed work failed")
    files = sorted(path for path in (case.folder / "programs").rglob("*") if path.is_file())
    for path in case.rng.sample(files, k=min(len(files), case.rng.randint(1, 12))):
        content, way = bytearray(path.read_bytes()), case.rng.randrange(5)
        if way == 0:
            content = content[: case.rng.randrange(len(content) + 1)]
        elif way == 1 and content:
            content[case.rng.randrange(len(content))] ^= 1 << case.rng.randrange(8)
        elif way == 2:
            content = bytearray(case.rng.randbytes(len(content)))
        elif way == 3:
            content = bytearray()
        path.unlink()
        if way == 4:
            path.mkdir()
        else:
            path.write_bytes(content)
    return case.end(case.begin())


def ten_at_once(case: Case, whole: float) -> bool:
    """Start ten processes on one new folder, and kill some of them."""
    processes = [case.begin() for _ in range(10)]
    time.sleep(case.rng.uniform(0, whole))
    for process in processes[:3]:
        case.kills += process.poll() is None
        kill_all(process)
    done = [case.end(process) for process in processes[3:]]
    if not all(done):
        raise Broken("of ten processes on one folder some failed")
    return True


def full(case: Case, _: float) -> bool:
    """No file may grow beyond a random size, as on a full disk."""
    size = int(10 ** case.rng.uniform(1, 5))
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))  # noqa: E731
    return case.end(case.begin(limit))


def memory(case: Case, _: float) -> bool:
    """Memory ends at a random moment."""
    size = int(case.rng.uniform(0.3, 3.0) * 2**30)
    limit = lambda: resource.setrlimit(resource.RLIMIT_DATA, (size, size))  # noqa: E731
    process = case.begin(limit)
    with contextlib.suppress(Broken):  # whatever library met the limit, it may have ended the process
        return case.end(process)
    kill_all(process)
    return False


DISTURBANCES: dict[str, Callable[[Case, float], bool]] = {
    "kill": kill,
    "kill a worker": kill_worker,
    "damage": damage,
    "ten at once": ten_at_once,
    "full": full,
    "memory": memory,
}


def play(number: int, known: dict[str, tuple[dict[str, np.ndarray], float]]) -> dict:
    """One case: what was done, and what broke."""
    kind, disturbance = CASES[number % len(CASES)]
    rng = random.Random(number)
    with tempfile.TemporaryDirectory() as name:
        case = Case(kind, Path(name), rng)
        broken = ""
        try:
            if kind not in known:
                known[kind] = undisturbed(kind)
            expected, whole = known[kind]
            found = case.finish(
                lambda: DISTURBANCES[disturbance](case, whole),
                LIMITED if disturbance in ("full", "memory") else ATTEMPTS,
            )
            for key, value in expected.items():
                if not np.array_equal(value, found[key], equal_nan=value.dtype.kind in "fc"):
                    raise Broken(f"`{key}` differs")
        except Broken as why:
            broken = str(why)
    return {
        "case": number,
        "kind": kind,
        "disturbance": disturbance,
        "kills": case.kills,
        "sentences": case.sentences,
        "broken": broken,
    }


def undisturbed(kind: str) -> tuple[dict[str, np.ndarray], float]:
    """Results of undisturbed work, and the seconds that it takes after its imports."""
    with tempfile.TemporaryDirectory() as name:
        case = Case(kind, Path(name), random.Random(0))
        for _ in range(1 if kind == "programs" else 2):  # programs are compiled in the first
            shutil.rmtree(name)
            Path(name).mkdir()
            process = case.begin()
            assert process.stdout is not None
            process.stdout.readline()
            start = time.monotonic()
            if not case.end(process):
                raise Broken(f"undisturbed work failed: {case.said[-600:]}")
            whole = time.monotonic() - start
        return case.result(), whole


def main() -> None:
    """Play cases until there were so many kills."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--kills", type=int, default=20, help="number of kills after which no case begins")
    parser.add_argument("--case", type=int, help="play this case alone, and print it")
    parser.add_argument("--out", type=Path, default=Path("out/faults"), help="folder of the tally")
    options = parser.parse_args()
    known: dict[str, tuple[dict[str, np.ndarray], float]] = {}
    if options.case is not None:
        print(json.dumps(play(options.case, known)))
        return
    options.out.mkdir(parents=True, exist_ok=True)
    tally = options.out / "tally.jsonl"
    lines = [json.loads(line) for line in tally.read_text().splitlines()] if tally.exists() else []
    while sum(line["kills"] for line in lines) < options.kills:
        lines.append(play(len(lines), known))
        with tally.open("a") as file:
            file.write(json.dumps(lines[-1]) + "\n")
        broken = [line for line in lines if line["broken"]]
        counted = Counter(f"{line['disturbance']} {line['kind']}" for line in lines)
        print(
            f"{len(lines)} cases, {sum(line['kills'] for line in lines)} kills, "
            f"{sum(line['sentences'] for line in lines)} sentences, {len(broken)} broken; last: {lines[-1]}",
            flush=True,
        )
    print(dict(counted) if lines else "nothing to do")


if __name__ == "__main__":
    main()
