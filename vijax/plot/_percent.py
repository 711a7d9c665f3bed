"""Percentages with as many digits as their standard errors leave."""

import math


def percent(share: float, error: float | None = None) -> str:
    """A share in per cent: rounded to the digit of its standard error, which is written behind it; `43 ± 5 %`.

    Without an error, as of the largest of several shares, to whole per cent; a share below one half is `< 1 %`.
    """
    value = 100 * share
    if error is None or not math.isfinite(error):
        return "< 1 %" if 0 < value < 0.5 else "> 99 %" if 99.5 < value < 100 else f"{value:.0f} %"
    if error == 0:  # all or none of the starts
        return f"{value:.3g} %"
    spread = 100 * error
    digits = max(0, -math.floor(math.log10(float(f"{spread:.0e}"))))
    return f"{value:.{digits}f} ± {spread:.{digits}f} %"
