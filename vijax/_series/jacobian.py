"""Derivatives of series by the series of a position or velocity, as further series of the same builder."""

from collections.abc import Sequence

import numpy as np

from .algebra import Operand, is_known
from .builder import Builder


def derivatives(build: Builder, series: Sequence[Operand], leaf: int) -> list[Operand]:
    """Derivatives of series by a leaf, known zeros where there is none."""
    operations = [operation for operation in build.operations if operation.out not in build.fixed]
    found: dict[int, Operand] = {leaf: np.float64(1)}

    def of(operand: Operand) -> Operand:
        return np.float64(0) if is_known(operand) else found.get(operand, np.float64(0))

    needed = {s for s in series if not is_known(s)}
    for operation in reversed(operations):
        if operation.out in needed:
            needed.update(a for a in operation.sources if not is_known(a))
    reach = {leaf}
    for operation in operations:
        if operation.out in needed and any(a in reach for a in operation.sources if not is_known(a)):
            reach.add(operation.out)
            found[operation.out] = operation.derivative(build, of)
    return [of(s) for s in series]
