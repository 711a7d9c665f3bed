"""Contacts between masses: a sweep of a free mass in a container beside one of as many masses and stops."""

import json
from functools import partial

import numpy as np

import vijax as vx

from .many import run_sweep
from .report import say
from .scenes import FREQUENCY, GOLDEN, Scene, sweep_error
from .timing import in_turns, repeated

SCENE = "damper_r07"
POINTS, PERIODS = 1000, 50


def contacts(full: bool) -> list[dict]:
    """What it costs that contacts share inertia: time of a step, and of the sweep."""
    scene = _load(SCENE)
    damper = _machine(scene)
    systems = {"contacts": damper, "stops": _with_stops(damper)}
    values = {FREQUENCY: scene["Omega"] * np.append(1.0, np.linspace(0.8, 1.2, POINTS - 1))}
    runs = {
        name: partial(run_sweep, system, values, transient=0, record=PERIODS, x0=scene["x0"], v0=scene["v0"])
        for name, system in systems.items()
    }
    found = {name: run() for name, run in runs.items()}
    timed = in_turns({name: repeated(run) for name, run in runs.items()}, 9 if full else 4)
    steps = {name: int(ds.steps.sum()) for name, ds in found.items()}
    rows = []
    for name, ds in found.items():
        seconds = timed[name]["min / s"]
        row = {
            "method": name,
            "points": POINTS,
            "error": sweep_error(ds, scene) if name == "contacts" else None,
            **timed[name],
            "steps": steps[name],
            "impacts": int(ds.num_impacts.sum()),
            "nanoseconds per step": 1e9 * seconds / steps[name],
            "ratio": seconds / steps[name] / (timed["stops"]["min / s"] / steps["stops"]),
        }
        rows.append(row)
        say(row)
    return rows


def _load(name: str) -> Scene:
    """A scene with contacts, told as scenes with stops are."""
    scene = json.loads((GOLDEN.parent / "golden_contacts" / f"{name}.json").read_text())
    events = [{**event, "stop": event["contact"]} for event in scene["events"]]
    return {**scene, "stops": scene["contacts"], "events": events}


def _machine(scene: Scene) -> vx.ImpactSystem:
    """The machine of a scene whose contacts stand still."""
    load = vx.Harmonic(scene["A"], scene["Omega"], scene["phase"], scene["mean"])
    between = [
        vx.Contact({i: a for i, a in enumerate(c["row"]) if a}, c["position"], c["restitution"])
        for c in scene["contacts"]
    ]
    return vx.ImpactSystem(np.diag(scene["M"]), scene["C"], scene["K"], load, between)


def _with_stops(damper: vx.ImpactSystem) -> vx.ImpactSystem:
    """The same masses with a weak spring between them, the second between two stops, which it hits about as often."""
    stops = [vx.Stop(1, 0.2, "upper", 0.7), vx.Stop(1, -0.2, "lower", 0.7)]
    spring = 0.2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return vx.ImpactSystem(damper.mass, damper.damping, damper.stiffness + spring, damper.forcing, stops)
