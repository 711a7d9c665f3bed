"""Golden scenes of loads by tables, see the README of data/golden_loads."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from switching_scenes import SwitchingScene

import vijax as vx

_DATA = Path(__file__).parent / "data" / "golden_loads"
# Chatter is followed to lighter bounces than the log of a scene has.
_OF_CHATTER = 10


class LoadScene(SwitchingScene):
    """A machine under loads by tables, a start, and the exact results."""

    @property
    def state_tolerance(self) -> float:
        """Tolerance of the end state."""
        data = self.data
        size = max(1.0, data["t1"] / 20) * max(1.0, data["amplification_worst_restart"])
        return 1e-13 * size * (_OF_CHATTER if data["chatters"] else 1)

    def time_tolerance(self, t: float) -> float:
        """Tolerance of the time of an event."""
        size = max(1.0, t) * max(1.0, self.data["amplification_worst_restart_events"])
        return 1e-13 * size * (_OF_CHATTER if self.data["chatters"] else 1)


def load_scene_names() -> list[str]:
    """Names of all scenes."""
    return sorted(path.stem for path in _DATA.glob("*.json"))


def scene_of_loads(name: str, *, as_contacts: bool = False) -> LoadScene:
    """A scene from its file; stops as contacts, if wanted."""
    data = json.loads((_DATA / f"{name}.json").read_text())
    stops = [_stop(one, as_contacts=as_contacts) for one in data["contacts"]]
    load: Any = sum(_load(one) for one in data["loads"])
    system = vx.ImpactSystem(np.diag(data["M"]), data["C"], data["K"], load, stops)
    return LoadScene(name, data, system)


def _stop(one: dict, *, as_contacts: bool) -> vx.Stop | vx.Contact:
    row = {i: a for i, a in enumerate(one["row"]) if a}
    ((mass, sign),) = list(row.items())[:1]
    if as_contacts or len(row) > 1:
        return vx.Contact(row, one["position"], one["restitution"])
    return vx.Stop(mass, sign * one["position"], "upper" if sign > 0 else "lower", one["restitution"])


def _load(one: dict) -> Any:
    numbers = {name: a for name, a in one.items() if name != "load"}
    if one["load"] == "base":
        return vx.base_excitation(numbers["mass"], acceleration=_load(numbers["acceleration"]))
    kinds = {"harmonic": vx.Harmonic, "tabulated": vx.Tabulated, "waveform": vx.Waveform}
    return kinds[one["load"]](**numbers)
