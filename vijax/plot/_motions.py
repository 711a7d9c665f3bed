"""Labels of motions, and their colours by family."""

from collections import Counter
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from ._colors import curve_colors, ink, is_dark, with_lightness
from ._mesh import check_plane

# Kinds that repeat, subdivided by impacts and periods.
_REPEATING = ("periodic", "chattering")
_WORDS = {"non_impacting": "no impact", "non_periodic": "non-periodic", "not_settled": "not settled"}
# Hatch patterns of motions without a known kind.
HATCHES = {"not settled": "////", "failed": "xxxx"}
# Codes in place of a number of impacts: infinitely many; not counted, because the log was cut.
_COMPLETE_CHATTER, _UNCOUNTED = -1, -2
# By dark background: lightness of the first and the last motion with a colour of its own.
_LADDER = {False: (0.86, 0.22), True: (0.28, 0.88)}


class MotionKind(NamedTuple):
    """A kind of motion, with its periods and impacts per stop if it repeats."""

    kind: str
    num_periods: int = 0
    num_impacts: tuple[int, ...] = ()

    @property
    def words(self) -> str:
        """Legend label: `1 | 2 in 1`."""
        if self.kind not in _REPEATING:
            return _WORDS.get(self.kind, self.kind.replace("_", " "))
        if _UNCOUNTED in self.num_impacts:
            return f"not counted, in {self.num_periods}"
        impacts = " | ".join(r"$\infty$" if m == _COMPLETE_CHATTER else str(m) for m in self.num_impacts)
        return f"{impacts} in {self.num_periods}"

    @property
    def family(self) -> str:
        """Name of the family of motions with the same hue; empty for none."""
        if self.kind == "periodic":
            return f"repeats after {self.num_periods}"
        return "chatters, then sticks" if self.kind == "chattering" else ""

    @property
    def place(self) -> tuple:
        """Sort key of the legend."""
        kinds = ("non_impacting", *_REPEATING, "non_periodic")
        rank = kinds.index(self.kind) if self.kind in kinds else len(kinds)
        return rank, self.kind, self.num_periods, self.num_impacts


class Entry(NamedTuple):
    """One legend entry of a chart: the motions of one colour.

    Attributes:
        words: its label.
        family: meaning of its hue; empty for none.
        color: red, green and blue.
        motions: the motions it covers.
        is_other: whether it covers the rare motions.
    """

    words: str
    family: str
    color: Any
    motions: list[MotionKind]
    is_other: bool = False


def label_of_motion(motion: xr.Dataset) -> str:
    """Legend label of a single motion, from `motion`, `num_periods` and `num_impacts`."""
    (one,) = motions_of(motion.expand_dims("point"))
    return one.words


def legend_title(ds: xr.Dataset) -> str:
    """Legend title, which explains the numbers in the labels of motions."""
    stops = " | ".join(str(j) for j in range(ds.sizes["stop"]))
    masses = ds["stop_mass"].values if "stop_mass" in ds.coords else np.array([-1])
    of_masses = ""
    if (masses >= 0).all():
        of = "mass" if len(set(masses.tolist())) == 1 else "masses"
        of_masses = f"\nof {of} {' | '.join(map(str, masses))}"
    return f"impacts at stop {stops}{of_masses}\nin forcing periods"


def check_motions(classes: xr.Dataset, max_classes: int) -> None:
    """Raise unless the dataset is a chart."""
    for name in ("motion", "num_periods", "num_impacts"):
        if name not in classes:
            raise ValueError(f"A region chart needs the variable `{name}`, but there are {list(classes)}.")
    check_flags(classes.motion)
    check_plane(classes.motion, "A region chart")
    if max_classes < 0:
        raise ValueError(f"Argument `max_classes` must be 0 or more, but is {max_classes}.")


def check_flags(motion: xr.DataArray) -> None:
    """Raise unless kinds of motion say what their numbers mean."""
    if not {"flag_values", "flag_meanings"} <= set(motion.attrs):
        raise ValueError("The variable `motion` must have the attributes `flag_values` and `flag_meanings`.")


def motions_of(classes: xr.Dataset) -> list[MotionKind]:
    """The motion at every point, in row-major order."""
    flags = classes.motion.attrs
    values = np.asarray(flags["flag_values"]).tolist()
    meaning = dict(zip(values, flags["flag_meanings"].split(), strict=True))
    dims = classes.motion.dims
    motion = classes.motion.values.ravel().tolist()
    periods = classes.num_periods.transpose(*dims).values.ravel().tolist()
    counts = classes.num_impacts.transpose(*dims, "stop").values.reshape(len(motion), -1)
    impacts = np.nan_to_num(counts, nan=_UNCOUNTED, posinf=_COMPLETE_CHATTER).astype(int).tolist()
    return [
        MotionKind(meaning[k], n, tuple(m)) if meaning[k] in _REPEATING else MotionKind(meaning[k])
        for k, n, m in zip(motion, periods, impacts, strict=True)
    ]


def legend_entries(of_point: list[MotionKind], max_classes: int) -> tuple[list[Entry], np.ndarray]:
    """Legend entries in order, and for each point the number of its entry.

    All but the `max_classes` most frequent repeating motions are "other".
    """
    counts = Counter(of_point)
    repeating = [motion for motion, _ in counts.most_common() if motion.kind in _REPEATING]
    named = sorted(repeating[:max_classes], key=lambda motion: motion.place)
    hues = _hues(named)
    ladder = np.linspace(*_LADDER[is_dark()], len(named))
    found = [
        Entry(motion.words, motion.family, with_lightness(hues[motion.family], grey), [motion])
        for motion, grey in zip(named, ladder, strict=True)
    ]
    plain = {"non_impacting": plt.rcParams["axes.facecolor"], "non_periodic": ink()}
    for motion in sorted(set(counts) - set(repeating), key=lambda motion: motion.place):
        entry = Entry(motion.words, "", plain.get(motion.kind, color_of_unknown()), [motion])
        found.insert(0, entry) if motion.kind == "non_impacting" else found.append(entry)
    if rare := repeating[max_classes:]:
        found.append(Entry("other", "", color_of_other(), rare, is_other=True))
    numbers = {motion: k for k, entry in enumerate(found) for motion in entry.motions}
    return found, np.array([numbers[motion] for motion in of_point])


def color_of_other() -> str:
    """Grey of motions without a colour of their own."""
    return ink("0.93", "0.15")


def color_of_unknown() -> str:
    """Grey of unknown motions, which are hatched."""
    return ink("0.75", "0.25")


def _hues(named: list[MotionKind]) -> dict[str, np.ndarray]:
    """A colour of the style for each family, in the order of the legend."""
    families = list(dict.fromkeys(motion.family for motion in named))
    return dict(zip(families, curve_colors(len(families))[:, :3], strict=True))
