"""Proof that a motion without impacts will never have one.

Such a motion is the periodic response of its machine plus a free vibration that decays. Two bounds show that
their sum never reaches a stop:

- The response along the row of each stop or contact, minus the motion of the contact, is a sum of harmonics,
  g(a) = Re sum_h Z_h exp(i h a). At its maximum g' = 0, and the nearest of N samples is at most pi / N away, so
  max g <= max of the samples + (pi / N)^2 / 2 sum_h h^2 |Z_h|.
  Of a wave form harmonics are left out, and a bound of their sum counts as free vibration.
- The energy E of the free vibration never grows, so |a . z| <= sqrt(2 E a K^-1 a) along a row a at all later times.

(Decaying exponentials, mode by mode, would give a smaller bound of the free vibration, but the modes of
machines with non-proportional damping are not orthogonal, and may be nearly parallel.)
"""

import numpy as np
import xarray as xr

from .._machine.machine import Machine
from .._trajectory.solution import Solution
from .record import forcing_periods, is_linear, machines
from .response import harmonics_of, modes_of, residual_vibration, response_of
from .section_side import padded_to_power_of_two
from .table_waves import lanes_first

# Points per block: the machines of all points at once would need much memory.
_BLOCK = 1 << 13
_SAMPLES, _ROOM = (64, 1024), 1 << 20


def prove_non_impacting(
    source: Solution | xr.Dataset, which: np.ndarray, x: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Prove that motions settle on the periodic response of their machine without another impact.

    Args:
        source: result of `vx.simulate` or `vx.sweep`.
        which: indices of the points to be proved.
        x: positions of all points at the end of their last forcing period, (points, n).
        v: velocities, likewise.

    Returns:
        Flags of what is proved, and the factor by which the distance from the response shrinks in a forcing period, NaN
        where nothing is proved, (points,) each.
    """
    period = forcing_periods(source)
    is_proved, factor = np.zeros(len(x), bool), np.full(len(x), np.nan)
    for first in range(0, len(which) if is_linear(source) else 0, _BLOCK):
        block = padded_to_power_of_two(which[first : first + _BLOCK])
        machine, angle = machines(source, block)
        if machine is None or not machine.is_periodic or len(machine.mean) != x.shape[1]:
            break
        is_proved[block], contraction = never_hits(machine, angle, x[block], v[block])
        # Not proved where a coordinate was dropped from the dataset: the machine is then another one.
        is_proved[block] &= np.isclose(lanes_first(machine.period), period[block], rtol=1e-5, atol=0)
        factor[block] = np.where(is_proved[block], contraction, np.nan)
    return is_proved, factor


def never_hits(machine: Machine, angle: float, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prove that motions never reach a stop again.

    Args:
        machine: linear machines, lanes last: one for each motion, or a single one shared by all.
        angle: a phase of the load.
        x: positions in the fixed frame at that phase, (lanes, n).
        v: velocities, likewise.

    Returns:
        Flags of what is proved, and the factor by which the distance from the periodic response shrinks in a forcing
        period, exp(max Re lambda T), (lanes,) each.
    """
    modes = modes_of(machine)
    response = response_of(machine, modes)
    left = residual_vibration(machine, modes, response, angle, (x, v)) + response.of_positions
    is_clear = np.broadcast_to(modes.is_damped, left.shape).copy()
    limits, rows = (lanes_first(a) for a in (machine.contacts.limit, machine.contacts.rows))
    own = harmonics_of(machine.contacts.walls, machine.contacts.num, response.num_harmonics)
    for j in range(machine.contacts.num):
        row = (rows[:, j, None] @ modes.shapes)[:, 0]
        waves = (response.waves @ row[..., None])[..., 0] - own[..., j]
        room = limits[:, j] - modes.rounding * (abs(limits[:, j]) + abs(own[..., j]).sum(axis=1))
        room = room - np.real(waves[:, 0]) - np.linalg.norm(row, axis=1) * left
        is_clear &= highest(waves[:, 1:], room) < room
    factor = np.exp(modes.decay * lanes_first(machine.period))
    return is_clear, np.broadcast_to(factor, left.shape)


def highest(waves: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Bound Re sum_h waves_h exp(i h a), h = 1, 2, ..., from above for all a, as closely as `room` requires.

    Args:
        waves: (lanes, harmonics).
        room: value that the bound should stay below, (lanes,).
    """
    orders = np.arange(1, waves.shape[1] + 1)
    waves = np.broadcast_to(waves, (len(room), len(orders)))
    bound, curvature = np.abs(waves).sum(axis=1), (orders**2 * np.abs(waves)).sum(axis=1)
    with_mean = np.pad(waves, [(0, 0), (1, 0)])
    for each in _SAMPLES if len(orders) > 1 else ():  # for one harmonic this bound is the maximum
        num = each * len(orders)
        left = np.flatnonzero(bound >= room)
        for part in np.array_split(left, 1 + len(left) * num // _ROOM):
            samples = np.fft.fft(with_mean[part], num).real
            closer = samples.max(axis=1) + curvature[part] * (np.pi / num) ** 2 / 2
            bound[part] = np.minimum(bound[part], closer)
    return bound
