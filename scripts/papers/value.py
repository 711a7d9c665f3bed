"""A printed number beside the one found."""

from typing import NamedTuple

import pandas as pd


class Value(NamedTuple):
    """A printed number beside the one found.

    Attributes:
        machine: the machine, by the name of the source.
        quantity: the quantity.
        printed: the number as printed.
        digit: unit of its last digit, of which the number found may differ by a half.
        found: the number found.
        exact: the number from a closed form, or else by the code of `independent`; NaN if there is neither here.
        reason: why a printed number differs by more; empty if it does not.
    """

    machine: str
    quantity: str
    printed: float
    digit: float
    found: float
    exact: float = float("nan")
    reason: str = ""

    @property
    def is_met(self) -> bool:
        """True where printed and found number agree to the digits printed."""
        return abs(self.found - self.printed) <= 0.5 * self.digit * (1 + 1e-9)


def table_of(values: list[Value]) -> pd.DataFrame:
    """A row a number: printed, found, their difference, the difference from the closed form or from SciPy, and the reason."""
    rows = [
        {
            "machine": one.machine,
            "quantity": one.quantity,
            "printed": f"{one.printed:.14g}",
            "found": f"{one.found:.14g}",
            "found - printed": f"{one.found - one.printed:.1e}",
            "found - exact": "" if one.exact != one.exact else f"{one.found - one.exact:.0e}",
            "agrees": "yes" if one.is_met else one.reason or "NO",
        }
        for one in values
    ]
    return pd.DataFrame(rows)
