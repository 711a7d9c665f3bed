"""Golden scenes of dry friction and compliant stops, see the README of data/golden_switching and of data/golden_mixed."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from helpers import CHATTER_END, ROUNDING

import vijax as vx

_DATA = Path(__file__).parent / "data"
_KINDS = {
    getattr(vx, kind.upper()): kind
    for kind in ("impact", "stick", "release", "close", "open", "slip", "turn")
}
# A chatter has light impacts for a far shorter time than this.
_LONGEST_END = 0.05
# The end of a chatter is that of a geometric series of light bounces.
_STICK = 1e-8


class Happening(NamedTuple):
    """One line of a log: time, element (stops first, then friction), kind, velocity before."""

    t: float
    element: int
    kind: str
    velocity: float


class SwitchingScene(NamedTuple):
    """A machine, a start, and the exact results."""

    name: str
    data: dict
    system: vx.ImpactSystem

    def simulate(self) -> vx.Solution:
        """Trajectory by vijax."""
        data = self.data
        return vx.simulate(self.system, data["t0"], data["t1"], data["x0"], data["v0"])

    @property
    def num_stops(self) -> int:
        """Number of stops, rigid and compliant."""
        return len(self.system.stops)

    @property
    def expected(self) -> list[Happening]:
        """Events of the scene."""
        rigid = len(self.data["contacts"])
        first = {"contact": 0, "compliant": rigid, "friction": self.num_stops}
        return [
            Happening(e["t"], first[e["element"]] + e["index"], e["kind"], e["v_before"])
            for e in self.data["events"]
        ]

    def found(self, solution: vx.Solution) -> list[Happening]:
        """Events of a solution, without the ends of chatters, as in the scene."""
        log, n = solution.events, int(solution.num_events)
        columns = (np.asarray(a)[:n].tolist() for a in (log.t, log.stop, log.kind, log.velocity_minus))
        events = [Happening(t, stop, _KINDS[kind], v) for t, stop, kind, v in zip(*columns, strict=True)]
        for chatter in self.data["chatters"]:
            events = _without_end(events, chatter, self.num_stops)
        return events

    def check_events(self, solution: vx.Solution) -> None:
        """Every element has the same events, in the same order, and no others."""
        found, expected = self.found(solution), self.expected
        assert len(found) == len(expected)
        for element in range(self.num_stops + len(self.system.friction)):
            ours, theirs = ([e.kind for e in events if e.element == element] for events in (found, expected))
            assert ours == theirs, element

    def check_times(self, solution: vx.Solution) -> None:
        """The events of each element come at the same times."""
        key = lambda e: (e.element, e.t)  # noqa: E731
        pairs = zip(sorted(self.found(solution), key=key), sorted(self.expected, key=key), strict=True)
        for ours, theirs in pairs:
            tolerance = _STICK if theirs.kind == "stick" else 0.0
            assert abs(ours.t - theirs.t) <= tolerance + self.time_tolerance(theirs.t), (ours, theirs)

    def check_end(self, solution: vx.Solution, unit: float = 1.0) -> None:
        """The end state is the same; `unit` is the size of its numbers."""
        for name in ("x1", "v1"):
            np.testing.assert_allclose(
                getattr(solution, name), self.data[name], rtol=0, atol=unit * self.state_tolerance
            )

    @property
    def state_tolerance(self) -> float:
        """Tolerance of the end state."""
        return ROUNDING * max(1.0, self.data["amplification_worst_restart"])

    def time_tolerance(self, t: float) -> float:
        """Tolerance of the time of an event."""
        return ROUNDING * max(1.0, t) * max(1.0, self.data["amplification_worst_restart_events"])


def scene_names(folder: str = "golden_switching") -> list[str]:
    """Names of all scenes; in `golden_mixed` bodies touch, lean on each other, or rest on compliant stops."""
    return sorted(path.stem for path in (_DATA / folder).glob("*.json"))


def switching_scene(name: str) -> SwitchingScene:
    """A scene from its file."""
    return scene_of(name, data_of(name))


def scene_of(name: str, data: dict) -> SwitchingScene:
    """A scene from the fields of a file."""
    stops = [vx.Contact(_row(c), c["position"], c["restitution"]) for c in data["contacts"]]
    stops += [
        vx.CompliantContact(_row(c), c["position"], c["stiffness"], c["damping"], c["preload"])
        for c in data["compliant"]
    ]
    friction = [_friction(c, len(data["contacts"])) for c in data["friction"]]
    load = vx.Harmonic(data["A"], data["Omega"], data["phase"], data["mean"])
    mass = np.array(data["M"])
    mass = mass if np.any(mass - np.diag(np.diag(mass))) else np.diag(mass)
    system = vx.ImpactSystem(mass, data["C"], data["K"], load, stops, friction=friction)
    return SwitchingScene(name, data, system)


def shape_of(name: str) -> tuple:
    """Properties for which a program is compiled."""
    data = data_of(name)
    is_full = np.any(np.array(data["M"]) - np.diag(np.diag(data["M"])))
    return data["n"], *(len(data[kind]) for kind in ("contacts", "compliant", "friction")), bool(is_full)


def _friction(element: dict, num_contacts: int) -> vx.Friction:
    if "force" in element:
        return vx.Friction(_row(element), element["force"], element["static"], element["belt"])
    normal = element["normal"]
    number = normal["index"] + (num_contacts if normal["element"] == "compliant" else 0)
    static = element["static_coefficient"]
    return vx.Friction(
        _row(element),
        velocity=element["belt"],
        coefficient=element["coefficient"],
        static_coefficient=None if static == element["coefficient"] else static,
        contact=number,
    )


def _row(element: dict) -> dict[int, float]:
    return {i: a for i, a in enumerate(element["row"]) if a}


def data_of(name: str) -> dict:
    """Fields of the file of a scene."""
    paths = (
        _DATA / folder / f"{name}.json" for folder in ("golden_switching", "golden_mixed", "golden_coulomb")
    )
    (path,) = (path for path in paths if path.exists())
    return json.loads(path.read_text())


def _without_end(events: list[Happening], chatter: dict, num_stops: int) -> list[Happening]:
    """Drop the light impacts of contacts before the end of their chatter, and what they open or turn between them."""
    end, contacts = chatter["end"], chatter.get("contacts") or [chatter["contact"]]
    rubbing = [num_stops + k for k in chatter["friction"]]
    is_before = lambda t: end - _LONGEST_END < t < end + 1e-6  # noqa: E731
    light = [
        e.t
        for e in events
        if e.element in contacts and e.kind == "impact" and is_before(e.t) and abs(e.velocity) < CHATTER_END
    ]
    if not light:
        return events
    is_end = lambda e: is_before(e.t) and e.t >= min(light)  # noqa: E731
    dropped = [(k, "impact") for k in contacts] + [(k, "turn") for k in rubbing]
    return [e for e in events if not (is_end(e) and (e.element, e.kind) in dropped)]
