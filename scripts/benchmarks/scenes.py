"""What is right: scenes solved to 36 digits by an independent method, and how far from them a program is."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import vijax as vx

GOLDEN = Path(__file__).parents[2] / "tests" / "data" / "golden"
# Impacts lighter than this are not compared: each program ends a chatter in its own way.
LIGHT = 1e-5
# A mass so deep in its stop has fallen through.
_DEEP = 1e-4
# Looks between two impacts when a log is played again.
_LOOKS = 50
FREQUENCY = "forcing.frequency"
# Forcing periods of the paper's sweeps: discarded, recorded.
TRANSIENT, RECORD = 100, 20
# Forcing periods and room for impacts where the number of points grows, about a scene.
SHORT, ROOM = 20, 16
LIGHT_SCENE = "paper_a_om080"

Impacts = list[tuple[float, int, float]]
Scene = dict[str, Any]


class Outcome(NamedTuple):
    """What a program says became of a scene.

    Attributes:
        impacts: time, stop and velocity before, of each.
        end: x and v at the end, (2 n,).
        gave_up: whether it was stopped because of its many impacts.
    """

    impacts: Impacts
    end: np.ndarray
    gave_up: bool = False


class Program(NamedTuple):
    """A scene, ready to run.

    Attributes:
        outcome: runs it and tells what became of it.
        seconds: runs it a number of times and tells how long each took.
    """

    outcome: Callable[[], Outcome]
    seconds: Callable[[int], list[float]]


@cache
def load(name: str) -> Scene:
    """A scene by its name."""
    return json.loads((GOLDEN / f"{name}.json").read_text())


def scenes_of_case(case: str) -> list[Scene]:
    """The scenes of a machine of the paper, "a" or "b"."""
    return [load(path.stem) for path in sorted(GOLDEN.glob(f"paper_{case}_*.json"))]


def machine(scene: Scene) -> vx.ImpactSystem:
    """The machine of a scene, for vijax."""
    load_ = vx.Harmonic(scene["A"], scene["Omega"], scene["phase"])
    stops = [vx.Stop(s["mass"], s["position"], s["side"], s["restitution"]) for s in scene["stops"]]
    return vx.ImpactSystem(scene["M"], scene["C"], scene["K"], load_, stops)


def frequencies_around(
    scene: Scene, points: int, low: float = 0.75, high: float = 1.75
) -> dict[str, np.ndarray]:
    """Values for a sweep: the frequency of a scene, and others in a range around it."""
    return {FREQUENCY: scene["Omega"] * np.append(1.0, np.linspace(low, high, points - 1))}


def judge(outcome: Outcome, scene: Scene) -> dict[str, Any]:
    """How far a program is from the truth.

    Returns:
        The largest errors of the time of an impact (None if the impacts are others than those of the
        scene) and of the state at the end (None if it never got there), and in words what happened.
    """
    found = [impact for impact in outcome.impacts if abs(impact[2]) > LIGHT]
    time_off = time_error(found, exact_impacts(scene))
    end = np.array([*scene["x1"], *scene["v1"]])
    state_off = None if outcome.gave_up else float(np.max(np.abs(outcome.end - end)))
    if outcome.gave_up:
        what = "gave up"
    elif time_off is not None:
        what = "right"
    else:
        what = "fell through a stop" if deepest(outcome, scene) > _DEEP else "impacts missed or added"
    return {"time error": time_off, "state error": state_off, "outcome": what}


def exact_impacts(scene: Scene, until: float = np.inf) -> Impacts:
    """The impacts of a scene that are compared."""
    rows = [(e["t"], e["stop"], e["v_before"]) for e in scene["events"] if e["kind"] == "impact"]
    return [row for row in rows if abs(row[2]) > LIGHT and row[0] <= until]


def time_error(found: Impacts, exact: Impacts) -> float | None:
    """The largest error of a time, or None if one is missed, added or of another stop."""
    if [row[1] for row in found] != [row[1] for row in exact]:
        return None
    return max((abs(a[0] - b[0]) for a, b in zip(found, exact, strict=True)), default=0.0)


def sweep_error(ds: xr.Dataset, scene: Scene, point: int = 0) -> float | None:
    """The largest error of an impact time of one point of a sweep without transient that is a scene.

    If the room for its impacts was too small, those that found room are compared; if the machine has
    more stops than the scene, those of the scene, which come first.
    """
    row = ds.isel({ds[FREQUENCY].dims[0]: point})
    columns = (row[f"impact_{name}"].values.tolist() for name in ("time", "stop", "velocity"))
    rows = [impact for impact in zip(*columns, strict=True) if impact[1] >= 0]
    is_cut = int(row.num_impacts.sum()) > len(rows)
    until: float = min(scene["t1"], rows[-1][0] + 1e-9) if is_cut and rows else scene["t1"]
    own = [r for r in rows if r[1] < len(scene["stops"]) and abs(r[2]) > LIGHT]
    return time_error([r for r in own if r[0] <= until], exact_impacts(scene, until))


def deepest(outcome: Outcome, scene: Scene) -> float:
    """How deep a mass went into a stop, if the impacts that a program tells are all there were.

    Between them the motion is that of the free machine, z' = F z for z = (x, v, cos, sin).
    """
    n, frequency = scene["n"], scene["Omega"]
    rate, z = _free_motion(scene)
    values, vectors = np.linalg.eig(rate)
    inverse = np.linalg.inv(vectors)
    depth, t = 0.0, scene["t0"]
    for time, number, _ in [*outcome.impacts, (scene["t1"], -1, 0.0)]:
        looks = np.linspace(0.0, time - t, _LOOKS)
        motion = ((vectors * (inverse @ z)) @ np.exp(np.outer(values, looks))).real
        for stop in scene["stops"]:
            sign = 1 if stop["side"] == "upper" else -1
            depth = max(depth, float(np.max(sign * (motion[stop["mass"]] - stop["position"]))))
        t, z = time, motion[:, -1]
        z[2 * n :] = np.cos(frequency * t), np.sin(frequency * t)
        if number >= 0:
            stop = scene["stops"][number]
            z[stop["mass"]] = stop["position"]
            z[n + stop["mass"]] *= -stop["restitution"]
    return depth


def smooth_end(scene: Scene) -> np.ndarray:
    """What x and v at the end of a scene were without its stops."""
    rate, z = _free_motion(scene)
    values, vectors = np.linalg.eig(rate)
    motion = (vectors * np.exp(values * (scene["t1"] - scene["t0"]))) @ np.linalg.solve(vectors, z)
    return motion.real[: 2 * scene["n"]]


def _free_motion(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """F and the start of z."""
    n, frequency = scene["n"], scene["Omega"]
    mass, phase, load_ = (np.array(scene[name]) for name in ("M", "phase", "A"))
    rate = np.zeros((2 * n + 2, 2 * n + 2))
    rate[:n, n : 2 * n] = np.eye(n)
    rate[n : 2 * n, :n] = -np.array(scene["K"]) / mass[:, None]
    rate[n : 2 * n, n : 2 * n] = -np.array(scene["C"]) / mass[:, None]
    rate[n : 2 * n, 2 * n] = load_ * np.cos(phase) / mass
    rate[n : 2 * n, 2 * n + 1] = -load_ * np.sin(phase) / mass
    rate[2 * n, 2 * n + 1], rate[2 * n + 1, 2 * n] = -frequency, frequency
    angle = frequency * scene["t0"]
    return rate, np.array([*scene["x0"], *scene["v0"], np.cos(angle), np.sin(angle)])
