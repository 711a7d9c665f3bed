"""One mass with one impact in n periods of its load, in closed form, differentiable by all numbers of the machine."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import expm

import vijax as vx


class Numbers(NamedTuple):
    """Parameters of `vx.models.impact_oscillator` without the frequency."""

    position: float
    restitution: float
    damping_ratio: float
    amplitude: float = 1.0

    def machine(self, w) -> vx.ImpactSystem:
        return vx.models.impact_oscillator(
            w,
            self.amplitude,
            position=self.position,
            restitution=self.restitution,
            damping_ratio=self.damping_ratio,
        )


def _flight(w, numbers, periods):
    """Matrix of the free motion over n periods, (2, 2)."""
    generator = jnp.array([[0.0, 1.0], [-1.0, 0.0]]) + 2 * numbers.damping_ratio * jnp.array(
        [[0.0, 0.0], [0.0, -1.0]]
    )
    return expm(generator * 2 * jnp.pi * periods / w)


def _shift(w, numbers, periods):
    """Response minus (position, 0) at an impact of speed 1, as in `test_closed_branch.closed_form`."""
    flight, step = _flight(w, numbers, periods), jnp.array([0.0, 1.0])
    return jnp.linalg.solve(jnp.eye(2) - flight, step + numbers.restitution * flight @ step)


def quadratic(w, numbers, periods):
    """Coefficients a, b, c of a v^2 + b v + c = 0 for the impact speed v."""
    p, q = _shift(w, numbers, periods)
    reach = numbers.amplitude**2 / ((1 - w * w) ** 2 + (2 * numbers.damping_ratio * w) ** 2)
    return p**2 + (q / w) ** 2, 2 * numbers.position * p, numbers.position**2 - reach


def discriminant(w, numbers, periods):
    a, b, c = quadratic(w, numbers, periods)
    return b * b - 4 * a * c


def speed(w, numbers, periods, sign=1):
    """Impact speed of the faster orbit; of the slower one for `sign` = -1."""
    a, b, _ = quadratic(w, numbers, periods)
    return (-b + sign * jnp.sqrt(discriminant(w, numbers, periods))) / (2 * a)


def phase(w, numbers, periods, v):
    """W t modulo 2 pi at the impact."""
    p, q = np.array([numbers.position, 0.0]) + np.asarray(_shift(w, numbers, periods)) * v
    response = numbers.amplitude / (1 - w * w + 2j * numbers.damping_ratio * w)
    return float(np.angle((p - 1j * q / w) / response) % (2 * np.pi))


def step(w, numbers, periods, v):
    """Monodromy matrix from just before an impact to the next, (2, 2)."""
    angle, r, damping = phase(w, numbers, periods, v), numbers.restitution, 2 * numbers.damping_ratio
    force = numbers.amplitude * np.cos(angle) - numbers.position
    before, after = force - damping * v, force + damping * r * v
    return np.asarray(_flight(w, numbers, periods)) @ np.array([[-r, 0], [(after + r * before) / v, -r]])


def after_impact(w, numbers, periods, v):
    """Start on the orbit at phase 0, simulated from its impact to the next multiple of the period."""
    angle, period = phase(w, numbers, periods, v), 2 * np.pi / w
    system = numbers.machine(w)
    sol = vx.simulate(system, angle / w, period, [numbers.position], [-numbers.restitution * v])
    return sol.x1, sol.v1


def clearance(w, numbers, periods, v, samples=8001):
    """Least gap between two impacts, without the ends; negative if the orbit is not admissible."""
    angle, damping = phase(w, numbers, periods, v), 2 * numbers.damping_ratio
    response = numbers.amplitude / (1 - w * w + 1j * damping * w) * np.exp(1j * angle)
    ts = np.linspace(0, 2 * np.pi * periods / w, samples)
    z = np.array([numbers.position, -numbers.restitution * v]) - np.array(
        [response.real, (1j * w * response).real]
    )
    roots = np.roots([1.0, damping, 1.0]).astype(complex)
    free = np.exp(np.outer(ts, roots)) @ np.linalg.solve(np.stack([np.ones(2), roots]), z)
    gap = numbers.position - (free + response * np.exp(1j * w * ts)).real
    inner = gap[1:-1]
    is_least = (inner[1:-1] <= inner[:-2]) & (inner[1:-1] <= inner[2:])
    return min(inner[1:-1][is_least].min(initial=np.inf), 0 if inner[[0, -1]].min() < 0 else np.inf)
