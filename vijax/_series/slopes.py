"""Finite slopes of a force where its powers begin.

A power below 1 of a branch, as sqrt(max(x, 0)), has an infinite slope where the branch begins; x sqrt(abs(x)) has not. Each
series vanishes there as some power of the distance to the beginning: its rank. A slope of negative rank is infinite.
"""

from collections.abc import Callable, Iterable, Sequence
from math import inf

from .algebra import Operand, is_known
from .operations import Chosen, Fixed, Linear, Operation, Product, Quotient, Square
from .powers import ClosingPower, Power


def has_infinite_slope(operations: Sequence[Operation], slopes: Iterable[Operand]) -> bool:
    """Test whether any of `slopes`, the entries of the derivatives of a force, is infinite where a power begins."""
    slopes = [a for a in slopes if not is_known(a)]
    by_out = {operation.out: operation for operation in operations}
    bases = {a.args[0] for a in operations if isinstance(a, Power) and a.is_clipped and _exponent(a) < 1}
    small = [_small_at(base, by_out) for base in bases]
    return any(_is_infinite(operations, slopes, series) for series in small if series)


def _is_infinite(operations: Sequence[Operation], slopes: Sequence[int], small: set[int]) -> bool:
    multiples = {_direction(operation) for operation in operations if operation.out in small} - {None}
    small = small | {operation.out for operation in operations if _direction(operation) in multiples}
    rank: dict[int, float] = dict.fromkeys(small, 1.0)

    def of(operand: Operand) -> float:
        if is_known(operand):
            return inf if operand == 0 else 0.0
        return rank.get(operand, 0.0)

    for operation in operations:
        if operation.out not in rank:
            rank[operation.out] = _rank(operation, of)
    return any(of(a) < 0 for a in slopes)


def _direction(operation: Operation) -> tuple | None:
    """The same for sums that are multiples of each other; None of all else."""
    if not isinstance(operation, Linear):
        return None
    terms = sorted(zip(operation.args, operation.factors, strict=True))
    return *((a, c / terms[0][1]) for a, c in terms), operation.constant / terms[0][1]


def _rank(operation: Operation, of: Callable[[Operand], float]) -> float:
    """Rank of the result of an operation from those of its arguments; zero of functions that do not vanish."""
    args = operation.args
    if isinstance(operation, Linear):
        return min([*map(of, args), *([0.0] if operation.constant else [])])
    if isinstance(operation, Product):
        return sum(map(of, args))
    if isinstance(operation, Square):
        return 2 * of(args[0])
    if isinstance(operation, Quotient):
        return of(args[0]) - of(args[1])
    if isinstance(operation, Power) and operation.is_clipped:
        return _exponent(operation) * of(args[0])
    if isinstance(operation, ClosingPower):
        return of(args[0])
    if isinstance(operation, Chosen):
        return min(map(of, args[1:]))
    return 0.0


def _exponent(operation: Power) -> float:
    return float(operation.args[1]) if is_known(operation.args[1]) else 1.0


def _small_at(base: Operand, by_out: dict[int, Operation]) -> set[int]:
    """Series that vanish with a base as its first power: what it is a multiple of, and the cases it was chosen from.

    None if a case is a number other than zero, as in max(x, 0.01).
    """
    found, waiting = set(), [base]
    while waiting:
        a = waiting.pop()
        if is_known(a) and a != 0:
            return set()
        if is_known(a) or a in found:
            continue
        found.add(a)
        operation = by_out.get(a)
        if isinstance(operation, Chosen):
            waiting.extend(operation.args[1:])
        elif isinstance(operation, Linear) and len(operation.args) == 1 and not operation.constant:
            waiting.append(operation.args[0])
        elif isinstance(operation, Product):
            waiting.extend(a for a in operation.args if not isinstance(by_out.get(a), Fixed))
    return found
