"""Machines that keep their energy: which they are, and how much they have."""

import numpy as np

from .._system.compliant import AbstractCompliantLimit
from .._system.system import ImpactSystem, mass_matrix
from .tolerances import EXACT


def refuse_losses(system: ImpactSystem) -> None:
    """Refuse a machine whose energy changes, or that does not vibrate about a rest without contact.

    Raises:
        ValueError: for one, with what it has.
    """
    stiffness = np.asarray(system.stiffness)
    squares = np.linalg.eigvalsh((stiffness + stiffness.T) / 2)
    has: dict[str, bool] = {
        "a `damping`": bool(np.any(np.asarray(system.damping))),
        "a stiffness that is not symmetric": not np.allclose(
            stiffness, stiffness.T, rtol=0, atol=EXACT * abs(stiffness).max()
        ),
        "a negative stiffness": bool(squares.min() < -EXACT * abs(squares).max()),
        "a load": any(bool(np.any(np.asarray(load.size()))) for load in system.forcing.loads),
        "a `force`": system.force is not None,
        "friction": bool(system.friction),
        "Jenkins elements": bool(system.hysteresis),
        "first-order states": system.num_states > 0,
    }
    for name, is_there in has.items():
        if is_there:
            raise ValueError(
                f"Nonsmooth modes are those of a machine that keeps its energy, but this one has {name}."
            )
    for j, stop in enumerate(system.stops):
        if stop.motion is not None:
            raise ValueError(f"`stops[{j}]` moves, and the machine does not keep its energy.")
        if isinstance(stop, AbstractCompliantLimit):
            keeps = not np.any(np.asarray(stop.damping)) and not np.any(np.asarray(stop.preload))
            wanted = "`damping` and `preload` 0"
        else:
            restitution = stop.restitution  # pyright: ignore[reportAttributeAccessIssue]
            keeps = not callable(restitution) and bool(np.all(np.asarray(restitution) == 1))
            wanted = "`restitution` 1"
        if not keeps:
            raise ValueError(
                f"`stops[{j}]` loses energy, or is pressed at rest: nonsmooth modes need {wanted}."
            )
        if not float(stop.gap(np.zeros(system.num_masses), np.zeros(()))) > 0:
            raise ValueError(f"`stops[{j}]` touches the machine at rest, so that it has no linear modes.")


def energy_of(system: ImpactSystem, state: np.ndarray) -> float:
    """Energy of a state, (2 n,), with that of the compliant stops."""
    x, v = np.split(state, 2)
    kinetic = v @ mass_matrix(system.mass) @ v
    potential = x @ np.asarray(system.stiffness) @ x
    for stop in system.stops:
        if isinstance(stop, AbstractCompliantLimit):
            depth = max(0.0, -float(stop.gap(x, np.zeros(()))))
            potential += float(stop.stiffness) * depth**2
    return float(kinetic + potential) / 2
