"""Golden scenes of nonlinear, parametric and tabulated forces with rigid stops, known to 34 digits."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

import vijax as vx

FOLDER = Path(__file__).parent / "data" / "golden_analytic"
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))

# Force along a row at time t, displacement d and velocity u along it.
FORCES: dict[str, Callable[[Any, Any, Any, dict], Any]] = {
    "duffing": lambda t, d, u, p: -p["k3"] * d**3,
    "pendulum": lambda t, d, u, p: -p["a"] * jnp.sin(d),
    "magnet": lambda t, d, u, p: p["p"] / (p["gap"] - d) ** 2,
    "tanh": lambda t, d, u, p: -p["force"] * jnp.tanh(u / p["width"]),
    "drag": lambda t, d, u, p: -p["b"] * u * jnp.abs(u),
    "hertz": lambda t, d, u, p: -p["k"] * jnp.maximum(d - p["gap"], 0.0) ** 1.5,
    "backlash": lambda t, d, u, p: (
        -p["k"] * (jnp.maximum(d - p["gap"], 0.0) + jnp.minimum(d + p["gap"], 0.0))
    ),
    "mathieu": lambda t, d, u, p: -p["k1"] * jnp.cos(p["w"] * t + p["phase"]) * d,
    "meissner": lambda t, d, u, p: -p["k1"] * jnp.sign(jnp.cos(p["w"] * t + p["phase"])) * d,
    "table": lambda t, d, u, p: jnp.interp(t, p["times"], p["values"]),
    "characteristic": lambda t, d, u, p: -jnp.interp(d, p["points"], p["values"]),
    "pulse": lambda t, d, u, p: p["height"] * jnp.exp(-(((t - p["at"]) / p["width"]) ** 2)),
}


def scene(name: str) -> dict:
    """Scene of a name."""
    return json.loads((FOLDER / f"{name}.json").read_text())


def machine_of(given: dict) -> vx.ImpactSystem:
    """Machine of a scene; the numbers of its forces are its `args`."""
    n = given["n"]
    rows = [np.array([g["row"].get(str(i), 0.0) for i in range(n)]) for g in given["forces"]]
    laws = [FORCES[g["name"]] for g in given["forces"]]

    def force(t, x, v, args):
        along = [row * law(t, row @ x, row @ v, p) for row, law, p in zip(rows, laws, args, strict=True)]
        return sum(along[1:], start=along[0])

    stops = [vx.Stop(s["mass"], s["position"], s["side"], s["restitution"]) for s in given["stops"]]
    load = vx.Harmonic(given["A"], given["Omega"], given["phase"])
    mass, damping, stiffness = (np.array(given[name]) for name in "MCK")
    return vx.ImpactSystem(mass, damping, stiffness, load, stops, force=force)


def args_of(given: dict) -> list[dict]:
    """Numbers of the forces of a scene."""
    return [{key: np.asarray(value) for key, value in g["numbers"].items()} for g in given["forces"]]


def errors(given: dict, solution: Any) -> tuple[float, float]:
    """Largest errors of the end and of event times, in units of what a rounding error becomes; infinite where events differ."""
    count, events = int(solution.num_events), given["events"]
    stops = np.asarray(solution.events.stop)[:count]
    if count != len(events) or any(e["stop"] != s for e, s in zip(events, stops, strict=True)):
        return np.inf, np.inf
    end = np.r_[solution.x1, solution.v1] - np.r_[given["x1"], given["v1"]]
    late = [
        abs(float(t) - e["t"]) / max(1, e["t"])
        for t, e in zip(solution.events.t[:count], events, strict=True)
    ]
    to_end, to_events = (
        max(1, given[name]) for name in ("amplification_worst_restart", "amplification_worst_restart_events")
    )
    return float(np.abs(end).max() / to_end), float(max(late) / to_events)
