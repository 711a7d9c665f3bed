"""The class of symmetries of machines and of orbits; `symmetry_search.py` finds them."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A symmetry of a machine: if x(t) is a motion, so is S x(t + shift T) + offset.

    Attributes:
        matrix: S, a signed permutation, (n, n).
        shift: share of the forcing period T; 0 if nothing drives the machine.
        offset: d, (n,): zero but for a machine that is symmetric about another point.
        stops: for each stop the one whose events it takes over.
        friction: the same for friction elements.
        stretches: the matrix of the stretches of Jenkins elements, a signed permutation, (hysteresis, hysteresis).

    Example:
        ```python
        import numpy as np, vijax as vx
        stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
        machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 2.0), stops)
        (mirror,) = machine.symmetries()
        mirror.shift  # 1/2: x(t) -> -x(t + T / 2)
        ```
    """

    matrix: np.ndarray
    shift: Fraction
    offset: np.ndarray
    stops: tuple[int, ...]
    friction: tuple[int, ...]
    stretches: np.ndarray

    @property
    def order(self) -> int:
        """Number of times that S gives the identity."""
        return order_of(self.matrix)

    def image(self, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Map a state of an orbit, whose last coordinates are those of Jenkins elements, without the shift in time.

        Args:
            x: positions, (n,) or (n + hysteresis,).
            v: velocities, of the same shape.

        Returns:
            Positions and velocities of the image.

        Example:
            ```python
            import vijax as vx
            (mirror,) = vx.models.gear_pair(1.0, 0.3).symmetries()
            x, v = mirror.image([0.5], [0.1])
            ```
        """
        n = len(self.matrix)
        x, v = np.asarray(x), np.asarray(v)
        image = np.concatenate([self.matrix @ x[:n] + self.offset, x[n:]])
        return image, np.concatenate([self.matrix @ v[:n], self.stretches[:, : len(v) - n] @ v[n:]])

    def __repr__(self) -> str:
        partner = np.argmax(np.abs(self.matrix), axis=1)
        words = []
        for i, (j, own) in enumerate(zip(partner.tolist(), self.matrix, strict=True)):
            sign, offset = "-" if own[j] < 0 else "", self.offset[i]
            moved = f" {'+' if offset > 0 else '-'} {abs(offset):.6g}" if offset else ""
            if i != j or sign or moved:
                words.append(f"x{i} -> {sign}x{j}{moved}")
        later = f"{self.shift} of a period later" if self.shift else ""
        return f"<Symmetry {', '.join([*words, *([later] if later else [])])}>"


def order_of(matrix: np.ndarray) -> int:
    """Number of times that a signed permutation gives the identity."""
    power, order = matrix, 1
    while not np.array_equal(power, np.eye(len(matrix))):
        power, order = power @ matrix, order + 1
    return order
