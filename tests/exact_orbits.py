"""Periodic motions of the ready-made machines in closed form, in double precision."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

import vijax as vx


class Start(NamedTuple):
    """A machine and a start."""

    system: vx.ImpactSystem
    x: np.ndarray
    v: np.ndarray


class Table(NamedTuple):
    """A ball that hits a table once in n periods; `strength` is the table's acceleration amplitude over gravity."""

    n: int
    restitution: float
    gravity: float
    strength: float
    frequency: float = 3.0

    @property
    def slope(self) -> float:
        """-W y' / g at the impact.

        The ball flies n T, comes down as fast as it went up, and (1 + r) y' = (1 - r) g n T / 2 for its speed to
        repeat.
        """
        return -np.pi * self.n * (1 - self.restitution) / (1 + self.restitution)

    @property
    def angle(self) -> float:
        """W t + phase at the impact, where y'' < 0."""
        return float(np.arcsin(self.slope / self.strength))

    @property
    def speed(self) -> float:
        """Impact speed relative to the table."""
        return 2 * self.fall / (1 + self.restitution)

    @property
    def fall(self) -> float:
        """Impact speed in space, equal to the speed at which the ball went up."""
        return self.gravity * self.n * np.pi / self.frequency

    @property
    def amplitude(self) -> float:
        """Displacement amplitude of the table."""
        return self.strength * self.gravity / self.frequency**2

    def system(self, phase: float) -> vx.ImpactSystem:
        """The machine."""
        return vx.models.ball_on_table(
            self.frequency, self.amplitude, phase=phase, restitution=self.restitution, gravity=self.gravity
        )

    def later(self, share: float) -> "Start":
        """Start on the orbit, at a share of the flight after an impact."""
        r, g, w = self.restitution, self.gravity, self.frequency
        t = share * 2 * np.pi * self.n / w
        angle = self.angle + w * t
        # Height and velocity in the fixed frame.
        height = self.amplitude * np.cos(self.angle)
        speed = r * self.speed - self.amplitude * w * np.sin(self.angle)
        x = height + speed * t - g * t**2 / 2
        v = speed - g * t
        return Start(self.system(angle), np.array([x]), np.array([v]))


class Orbit(NamedTuple):
    """An orbit with an impact at an upper stop, and possibly another at its mirror image."""

    speed: float
    angle: float
    step: np.ndarray
    start: Callable[[float], tuple[float, np.ndarray]]


def exact_orbit(
    c: float, k: float, force: float, w: float, s: float, r: float, span: float, flip: int
) -> Orbit:
    """Motion of x'' + c x' + k x = force cos(w t + phase) that hits s at speed v every `span`.

    With `flip` = 1 the load returns after `span`; with -1 it is reversed, and the next impact is at -s. Let z be
    (x, x') minus the steady response, just before the impact at s. Just after the impact it is z - (1 + r) v e2, and
    E = expm(((0, 1), (-k, -c)) span) maps that to flip z: z = v u. At the impact the response has the position
    s - v u_1 and the velocity v (1 - u_2), and its amplitude is that of the load. This gives v, the larger root. The
    linearised impact is S = ((-r, 0), (b, -r)), b = (a+ + r a-) / v, with the accelerations before and after it.
    """
    a = np.array([[0.0, 1.0], [-k, -c]])
    e, e2 = scipy.linalg.expm(a * span), np.array([0.0, 1.0])
    u1, u2 = (1 + r) * np.linalg.solve(e - flip * np.eye(2), e @ e2)
    gain = force / (k - w**2 + 1j * c * w)
    v = np.roots([u1**2 + ((1 - u2) / w) ** 2, -2 * s * u1, s**2 - abs(gain) ** 2]).max()
    angle = np.angle(s - v * u1 - 1j * v * (1 - u2) / w) - np.angle(gain)
    push = force * np.cos(angle) - k * s
    s_matrix = np.array([[-r, 0.0], [(push + c * r * v + r * (push - c * v)) / v, -r]])

    def later(t: float) -> tuple[float, np.ndarray]:
        """Angle of the load and state at a time t after the impact."""
        wave = gain * np.exp(1j * (angle + w * t))
        return angle + w * t, scipy.linalg.expm(a * t) @ (v * np.array([u1, u2 - 1 - r])) + np.array(
            [wave.real, (1j * w * wave).real]
        )

    return Orbit(float(v), float(angle), s_matrix @ e, later)


def rattle(w: float, a: float, d: float, r: float) -> tuple[float, float]:
    """Angle b of the box and relative speed, at the impact on the upper wall.

    In the fixed frame, the mass leaves X = d + a cos b with the velocity u and is at -X half a period later, so
    u = -2 w X / pi; it came with -u. The wall moves by -a w sin b, and (1 - r) u = -(1 + r) a w sin b.
    """
    q = np.pi * (1 + r) / (1 - r) / 2
    angle = np.arcsin(d / a / np.hypot(1, q)) + np.arctan(1 / q)
    return float(angle), float(2 * w / np.pi * (d + a * np.cos(angle)) + a * w * np.sin(angle))
