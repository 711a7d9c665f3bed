"""Derivatives of series by the series of a position or velocity, as further series of the same builder."""

import numpy as np

from .builder import Builder
from .operations import Operand, is_known


class Column:
    """Derivatives by one leaf; known zeros where there is none."""

    def __init__(self, build: Builder, leaf: int):
        self._build = build
        self._found: dict[int, Operand] = {leaf: np.float64(1)}
        self._operations = dict(build.by_out)
        self._reach = _reach(build, leaf)

    def of(self, series: Operand) -> Operand:
        """Derivative of a series."""
        if is_known(series) or series not in self._reach:
            return np.float64(0)
        if series not in self._found:
            self._found[series] = self._operations[series].derivative(self._build, self.of)
        return self._found[series]


def _reach(build: Builder, leaf: int) -> set[int]:
    """Series that depend on a leaf."""
    reach = {leaf}
    for operation in build.operations:
        if operation.out not in build.fixed and any(a in reach for a in operation.args if not is_known(a)):
            reach.add(operation.out)
    return reach
