"""Degenerate machines: equal, doubled, touching, at rest, in whole ratios, as people build them and random numbers never are."""

import numpy as np

from .machines import largest_coefficients
from .shapes import Shape

# Share of the machines of a round to which each coincidence happens.
SHARE = 0.25


# What all elements of a kind may have in common, besides the masses of a diagonal matrix.
ALIKE = (
    *("position", "restitution", "distance", "cushion", "cushion_stiffness", "cushion_damping", "preload"),
    *("friction", "static", "belt", "slider_stiffness", "slider_limit", "amplitude", "phase", "v0"),
)
# Special values: plastic and elastic, without damper, load or preload, at rest, driven in whole ratios.
SPECIAL = {
    "restitution": (0.0, 1.0, 0.5),
    "damping": (0.0,),
    "mean": (0.0,),
    "amplitude": (0.0,),
    "v0": (0.0,),
    "preload": (0.0,),
    "cushion_damping": (0.0,),
    "frequency": (0.5, 1.0, 2.0, np.pi),
}
# Places of which the first may be 0: the machine starts on a stop, or two masses touch.
PLACES = "position", "distance", "cushion"
# Numbers that may be powers of two.
ROUND = "stiffness", "friction", "static", "slider_stiffness", "slider_limit", "frequency"


def degenerate(rng: np.random.Generator, shape: Shape, a: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Let coincidences happen to the numbers of many machines, each to some of them, (count, ...) each."""
    count = len(a["v0"])
    a = {name: np.array(value) for name, value in a.items()}

    def some() -> np.ndarray:
        return np.flatnonzero(rng.random(count) < SHARE)

    own_mass = () if shape.is_full else ("mass",)
    _even_chain(a, some())
    for name in (*own_mass, *ALIKE):
        own = some()
        if a[name].shape[1]:
            a[name][own] = a[name][own][:, :1]
    for name, values in SPECIAL.items():
        own = some()
        chosen = rng.choice(values, len(own)).reshape(-1, *[1] * (a[name].ndim - 1))
        a[name][own] = chosen * np.ones_like(a[name][own])
    for name in PLACES:
        if a[name].shape[1] and not (name == "position" and shape.is_moving):
            a[name][some(), 0] = 0.0
    for name in ("position", "distance"):
        _without_shut(shape, a, name)
    whole = some()
    for name in (*own_mass, *ROUND):
        a[name][whole] = _rounded(a[name][whole])
    a["static"] = np.maximum(a["static"], a["friction"])
    _diagonally_dominant(a)
    a["coefficient"] = np.minimum(a["coefficient"], largest_coefficients(shape, a))
    return a


def _rounded(a: np.ndarray) -> np.ndarray:
    """The nearest powers of two."""
    return np.where(a == 0, 0.0, np.sign(a) * 2.0 ** np.round(np.log2(np.maximum(np.abs(a), 1e-300))))


def _even_chain(a: dict[str, np.ndarray], own: np.ndarray) -> None:
    """The springs of a chain become equal, and its dampers proportional to them."""
    n = a["v0"].shape[1]
    ones = np.ones(max(n - 1, 0))
    chain = 2 * np.eye(n) - np.diag(ones, 1) - np.diag(ones, -1)
    first = a["stiffness"][own, :1, :1]
    share = a["damping"][own, :1, :1] / first
    a["stiffness"][own] = first * chain / 2
    a["damping"][own] = share * a["stiffness"][own]


def _without_shut(shape: Shape, a: dict[str, np.ndarray], name: str) -> None:
    """Two places that leave a mass no room are moved apart: the later one."""
    masses = [(i,) for i, _ in shape.stops] if name == "position" else shape.contacts
    keys = [frozenset(row) for row in masses]
    for j, key in enumerate(keys):
        if key in keys[:j]:
            is_shut = a[name][:, keys.index(key)] + a[name][:, j] <= 0
            a[name][:, j] = np.where(is_shut, 0.1, a[name][:, j])


def _diagonally_dominant(a: dict[str, np.ndarray]) -> None:
    """Rounded stiffnesses stay those of springs: no negative ones to the ground."""
    stiffness = a["stiffness"]
    n = stiffness.shape[1]
    lack = np.maximum(np.abs(stiffness * (1 - np.eye(n))).sum(axis=2) - np.einsum("bii->bi", stiffness), 0)
    a["stiffness"] = stiffness + np.einsum("bi,ij->bij", lack, np.eye(n))
