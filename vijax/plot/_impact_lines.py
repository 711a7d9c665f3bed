"""Impacts along a branch of orbits, each followed from the orbit where it appears to the one where it disappears."""

from typing import NamedTuple

import numpy as np

from .._branches.kinds import Kind


class OrbitImpacts(NamedTuple):
    """The impacts of an orbit at a stop, in the order of its cycle, (impacts,) each.

    Attributes:
        time: in forcing periods.
        speed: speed of approach to the stop.
        carried: velocity of the stop in the direction of approach; 0 for a contact between masses.
    """

    time: np.ndarray
    speed: np.ndarray
    carried: np.ndarray


def impact_lines(
    impacts: list[OrbitImpacts], kinds: np.ndarray, num_periods: int
) -> list[tuple[list[int], list[float]]]:
    """For each impact, its point numbers and velocities from where it appears to where it disappears."""
    lines: list[tuple[list[int], list[float]]] = []
    before, there = OrbitImpacts(*np.empty((3, 0))), {}
    for k, now in enumerate(impacts):
        earlier = _partners(before, now, num_periods)
        here = {}
        for i, velocity in enumerate(now.carried + now.speed):
            if i in earlier:
                here[i] = there.pop(earlier[i])
            else:
                # A new impact starts at the grazing before, with the velocity of the stop: its speed of approach is 0.
                is_born = k > 0 and kinds[k - 1] == Kind.GRAZING
                here[i] = ([k - 1], [float(now.carried[i])]) if is_born else ([], [])
                lines.append(here[i])
            here[i][0].append(k)
            here[i][1].append(float(velocity))
        for i, (numbers, velocities) in there.items():
            if kinds[k] == Kind.GRAZING:
                numbers.append(k)
                velocities.append(float(before.carried[i]))
        before, there = now, here
    return lines


def _partners(before: OrbitImpacts, now: OrbitImpacts, num_periods: int) -> dict[int, int]:
    """Match the impacts of a cycle (keys) to those of the cycle before it (values), in the order of both.

    Impacts appear and disappear with zero speed, at a grazing or at the end of a chatter: if one cycle has more, its
    slowest ones are unmatched. A cycle may begin at another impact than the one before it, so all rotations are tried.
    """
    count = min(len(before.time), len(now.time))
    if not count:
        return {}
    ours, theirs = (np.sort(np.argsort(-a.speed, kind="stable")[:count]) for a in (now, before))
    rotations = (np.arange(count)[:, None] + np.arange(count)) % count
    apart = now.time[ours][rotations] - before.time[theirs]
    apart -= num_periods * np.round(apart / num_periods)
    best = rotations[np.argmin((apart**2).sum(axis=1))]
    return dict(zip(ours[best].tolist(), theirs.tolist(), strict=True))
