"""Python code that repeats what the page shows."""

from collections.abc import Mapping
from typing import Any

from .motion import RECORD


def code_of(
    file: str, place: Mapping[str, Any], changes: Mapping[str, float], mass: int, record: int, transient: int
) -> str:
    """Program that simulates the shown motion and draws it.

    Args:
        file: name of the dataset, or empty if it is not known.
        place: value of each dimension of the sweep at the point, as in the dataset.
        changes: changed numbers of the machine by path.
        mass: mass of the phase portrait.
        record: forcing periods that are shown.
        transient: forcing periods before them, after a change.
    """
    lines = [
        "import jax",
        "import xarray as xr",
        "import vijax as vx",
        "",
        'jax.config.update("jax_enable_x64", True)',
    ]
    lines += [f'ds = xr.load_dataset("{file}")' if file else "# ds: what vx.sweep returned"]
    chosen = {name: value if isinstance(value, str) else float(value) for name, value in place.items()}
    lines += [
        f"point = ds.sel({chosen!r})",
        "system = vx.system_of(point)",
        "x0, v0 = point.x.values, point.v.values",
    ]
    if changes:
        values = {path: [float(value)] for path, value in changes.items()}
        lines += [
            f"changed = vx.sweep(system, {values!r}, transient={transient}, record={max(record, 1)}, x0=x0, v0=v0)",
            "point = changed.squeeze()",
            "system = vx.system_of(point)",
            "x0, v0 = point.x.values, point.v.values",
        ]
    lines += [
        f"sol = vx.simulate(system, 0.0, {max(record, RECORD)} * system.forcing.period, x0, v0, max_events=4096)",
        "ax = vx.plot.time_series(sol)",
        f"ax = vx.plot.phase_portrait(sol, {mass})",
        "ax.figure.savefig('motion.png')",
    ]
    return "\n".join(lines) + "\n"
