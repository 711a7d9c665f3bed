"""Golden scenes of Jenkins elements, see the README of data/golden_hysteresis."""

import json
from pathlib import Path

import vijax as vx

_DATA = Path(__file__).parent / "data" / "golden_hysteresis"


def data_of(name: str) -> dict:
    """The scene as it was stored."""
    return json.loads((_DATA / f"{name}.json").read_text())


def system_of(data: dict) -> vx.ImpactSystem:
    """The machine of a scene."""
    load = vx.Harmonic(data["A"], data["Omega"], data["phase"], data["mean"])
    rows = [{i: a for i, a in enumerate(one["row"]) if a} for one in data["jenkins"]]
    elements = [
        vx.Jenkins(row, one["stiffness"], one["limit"], one["z0"])
        for row, one in zip(rows, data["jenkins"], strict=True)
    ]
    mass = [data["M"][i][i] for i in range(data["n"])]
    return vx.ImpactSystem(mass, data["C"], data["K"], load, hysteresis=elements)
