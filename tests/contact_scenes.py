"""Machines with contacts between masses: golden scenes, and random ones.

A golden scene was solved by ball arithmetic to at least 36 proved digits, see data/golden_contacts/README.md, and is
compared like those of `helpers.py`.
"""

import json
from pathlib import Path

import numpy as np
from helpers import Scene, scene_of

import vijax as vx

_FOLDER = Path(__file__).parent / "data" / "golden_contacts"
FREQUENCY = 1.3


def contact_scene_names() -> list[str]:
    """Names of all scenes."""
    return sorted(path.stem for path in _FOLDER.glob("*.json"))


def contact_data(name: str) -> dict:
    """Data of a scene as stored."""
    return json.loads((_FOLDER / f"{name}.json").read_text())


def contact_scene(name: str) -> Scene:
    """A golden scene from its file."""
    data = contact_data(name)
    return scene_of(name, data, contact_machine(data), "contact")


def contact_machine(data: dict, basis: np.ndarray | None = None) -> vx.ImpactSystem:
    """Machine of a scene; in coordinates y with x = basis @ y, if a basis is given."""
    basis = np.eye(data["n"]) if basis is None else basis
    mass, damping, stiffness = (basis.T @ np.array(data[name]) @ basis for name in "MCK")
    if not np.any(mass - np.diag(np.diag(mass))):
        mass = np.diag(mass)
    load, phase = np.array(data["A"]), np.array(data["phase"])
    forcing = vx.Harmonic(
        np.hypot(basis.T @ (load * np.cos(phase)), basis.T @ (load * np.sin(phase))),
        data["Omega"],
        np.arctan2(basis.T @ (load * np.sin(phase)), basis.T @ (load * np.cos(phase))),
        basis.T @ np.array(data["mean"]),
    )
    contacts = []
    for contact in data["contacts"]:
        row = {i: a for i, a in enumerate(np.array(contact["row"]) @ basis) if a}
        motion = contact["motion"] and vx.Harmonic(
            np.array(contact["motion"]["amplitude"])[:, None],
            data["Omega"],
            np.array(contact["motion"]["phase"])[:, None],
        )
        contacts.append(vx.Contact(row, contact["position"], contact["restitution"], motion))
    return vx.ImpactSystem(mass, damping, stiffness, forcing, contacts)


def shape_of_scene(name: str) -> tuple:
    """Properties for which a program is compiled; harmonics are padded to powers of two."""
    data = contact_data(name)
    mass = np.array(data["M"])
    is_full, motions = (
        bool((mass - np.diag(np.diag(mass))).any()),
        [len(c["motion"]["amplitude"]) for c in data["contacts"] if c["motion"]],
    )
    harmonics = max((1 << (count - 1).bit_length() for count in motions), default=0)
    return data["n"], len(data["contacts"]), is_full, harmonics


def random_machine(
    seed: int,
    n: int,
    num_contacts: int,
    restitution: float | None = None,
    *,
    has_full_mass: bool = True,
    is_moving: bool = False,
    is_driven: bool = True,
) -> vx.ImpactSystem:
    """A machine with random matrices and rows, and small gaps; without a load its energy never grows."""
    random = np.random.default_rng(seed)
    square = lambda: (lambda a: a @ a.T / n)(random.normal(size=(n, n)))  # noqa: E731
    mass, stiffness, damping = square() + np.eye(n) / 2, square() + np.eye(n) / 10, square() / 20
    contacts = []
    for _ in range(num_contacts):
        row = random.normal(size=n)
        if random.random() < 0.5 and n > 1:
            row[random.integers(n)] = 0
        motion = vx.Harmonic([0.1 * random.random()], FREQUENCY, [6 * random.random()])
        r = random.choice([0.0, 0.3, 0.6, 0.9]) if restitution is None else restitution
        contacts.append(
            vx.Contact(dict(enumerate(row)), 0.15 + 0.4 * random.random(), r, motion if is_moving else None)
        )
    load = (0.3 + random.random()) * random.normal(size=n) if is_driven else np.zeros(n)
    mean = 0.3 * random.normal(size=n) if is_driven else np.zeros(n)
    forcing = vx.Harmonic(load, FREQUENCY, 6 * random.random(n), mean)
    mass = mass if has_full_mass else np.diag(mass)
    return vx.ImpactSystem(mass, damping, stiffness, forcing, contacts)


def rows_of(system: vx.ImpactSystem) -> np.ndarray:
    """Rows of the contacts, A, (contacts, n)."""
    rows = np.zeros((system.num_stops, system.num_masses))
    for j, stop in enumerate(system.stops):
        for i, a in stop.coefficients.items():
            rows[j, i] = float(a)
    return rows


def gaps_at(solution: vx.Solution, system: vx.ImpactSystem, t: np.ndarray) -> np.ndarray:
    """Gaps of contacts at some times, (times, contacts), from positions alone."""
    x, positions = np.asarray(solution.evaluate(t)[0]), np.asarray(solution.evaluate_stops(t)[0])
    return positions - x @ rows_of(system).T
