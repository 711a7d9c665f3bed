"""EDF, validation manual of code_aster, V5.02.032 (SDNL32): a beam that turns about a pin and hits a soft stop with its tip."""

import numpy as np
import scipy.linalg
from matplotlib.axes import Axes

import vijax as vx

from .independent_structures import beam_matrices, tip_on_stop
from .value import Value

LENGTH, WIDTH, MODULUS, DENSITY = 0.783, 0.014, 6.7e10, 2400.0
ELEMENTS, MODES, DAMPING_RATIO, STIFFNESS = 10, 10, 0.01, 18000.0
# Speed of turning, with which all slopes start; two of the printed velocities of nodes are not on the line.
TURNING, NODE, ODD_NODES = -3.8, -0.29754, {6: -1.7556, 10: -2.96786}
# Printed positions of the tip in mm at 1, 2, ... ms, and the force at the last one.
TIMES = 1e-3 * np.arange(1, 13)
PRINTED = (-2.66, -4.33, -4.92, -4.78, -3.82, -2.87, -2.71, -3.09, -3.41, -3.36, -2.64, -0.742)
PRINTED_FORCE = 13.36925


def velocities(odd_nodes: dict[int, float]) -> np.ndarray:
    """Velocities of the start, slopes and heights by turns as in `matrices`."""
    velocity = np.full(2 * ELEMENTS + 2, TURNING)
    velocity[::2] = NODE * np.arange(ELEMENTS + 1)
    for node, speed in odd_nodes.items():
        velocity[2 * node] = speed
    return velocity[1:]


def matrices() -> tuple[np.ndarray, np.ndarray]:
    """Assemble the mass and stiffness matrices of the pinned beam, of cubic elements without shear: slopes and heights by turns."""
    size, area, inertia = LENGTH / ELEMENTS, WIDTH**2, WIDTH**4 / 12
    mass, stiffness = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
    units = np.array([1.0, size, 1.0, size])
    of_mass = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
    of_stiffness = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    for i in range(ELEMENTS):
        at = slice(2 * i, 2 * i + 4)
        mass[at, at] += DENSITY * area * size / 420 * np.outer(units, units) * of_mass
        stiffness[at, at] += MODULUS * inertia / size**3 * np.outer(units, units) * of_stiffness
    return mass[1:, 1:], stiffness[1:, 1:]


def beam() -> tuple[vx.Solution, np.ndarray]:
    """Run the beam in its first modes, of which the first is the free turn; return the shape of the tip as well."""
    mass, stiffness = matrices()
    squares, shapes = scipy.linalg.eigh(stiffness, mass, subset_by_index=(0, MODES - 1))
    frequencies = np.sqrt(np.concatenate([[0.0], squares[1:]]))
    tip = shapes[-2]
    stop = vx.CompliantContact({i: -float(tip[i]) for i in range(MODES)}, 0.0, STIFFNESS)
    machine = vx.ImpactSystem(
        np.ones(MODES), np.diag(2 * DAMPING_RATIO * frequencies), np.diag(frequencies**2), stops=[stop]
    )
    return vx.simulate(machine, 0.0, TIMES[-1], np.zeros(MODES), shapes.T @ mass @ velocities(ODD_NODES)), tip


def by_scipy(odd_nodes: dict[int, float], *, with_shear: bool) -> np.ndarray:
    """Positions of the tip without vijax."""
    section = LENGTH / ELEMENTS, ELEMENTS, WIDTH, MODULUS, DENSITY
    mass, stiffness = beam_matrices(*section, with_shear=with_shear)
    return tip_on_stop(mass, stiffness, velocities(odd_nodes), MODES, DAMPING_RATIO, STIFFNESS, TIMES)


def values() -> list[Value]:
    """Positions of the tip, and the last force; as exact counts what SciPy finds for the same beam."""
    sol, tip = beam()
    found, exact = np.asarray(sol.evaluate(TIMES)[0]) @ tip, by_scipy(ODD_NODES, with_shear=False)
    as_printed = by_scipy({}, with_shear=True)
    rows = [
        Value("SDNL32", f"tip at {1e3 * t:.0f} ms", 1e-3 * y, 1e-5 if k < len(TIMES) - 1 else 1e-6, a, b)
        for k, (t, y, a, b) in enumerate(zip(TIMES, PRINTED, found.tolist(), exact.tolist(), strict=True))
    ]
    rows.append(Value("SDNL32", "force at 12 ms", PRINTED_FORCE, 1e-5, -STIFFNESS * float(found[-1])))
    with_shear = [*as_printed, -STIFFNESS * as_printed[-1]]
    return [
        one if one.is_met else one._replace(reason=f"with shear and nodes on a line SciPy finds {other:.5g}")
        for one, other in zip(rows, with_shear, strict=True)
    ]


def draw(axes: list[Axes]) -> None:
    """Draw the tip and the force on it."""
    sol, tip = beam()
    ts = np.linspace(0.0, TIMES[-1], 600)
    height = 1e3 * (np.asarray(sol.evaluate(ts)[0]) @ tip)
    left, right = axes
    left.plot(1e3 * ts, height)
    left.plot(1e3 * TIMES, PRINTED, "s", markerfacecolor="none", markersize=9)
    left.set(xlabel="Time (ms)", ylabel="Height of the tip (mm)")
    right.plot(1e3 * ts, -1e-3 * STIFFNESS * height)
    right.plot(1e3 * TIMES[-1], PRINTED_FORCE, "s", markerfacecolor="none", markersize=9)
    right.set(xlabel="Time (ms)", ylabel="Force on the tip (N)")
    left.set_title("SDNL32, printed values as squares", fontsize="medium")
