"""Curve of a bifurcation in the plane of two parameters."""

import json
from dataclasses import replace

import numpy as np
import xarray as xr

from .._dataset_attributes import variable_attributes, versions
from .._flow.taylor import TaylorFlow
from .._jax.arrays import Count, as_numpy_float, check_type, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._progress import interrupt_with_result, says_what_compiles, tqdm
from .._sweep.short_names import with_labels
from .._system.parameters import get_parameter
from .bifurcation_setup import defining_system_of
from .branch import Bifurcation, Peak
from .codim2_continuation import Curve, CurveState, begin_curve
from .defining_systems import AtBranchPoint, DefiningSystem
from .kinds import EndKind
from .parameter_family import ExtendedCycle
from .peak_condition import height_of
from .peak_quantities import peak_quantity
from .starts import family_of, starting_orbits
from .tolerances import NEGLIGIBLE


@says_what_compiles
@padding_allowed
def bifurcation_curve(
    point: Bifurcation,
    path: str,
    bounds: dict[str, tuple[float, float]],
    *,
    max_points: Count = 1000,
    progress: bool = True,
) -> xr.Dataset:
    """Follow a bifurcation in the plane of two parameters, in both directions.

    Pseudo-arclength continuation of its defining system passes cusps. Special points, where another bifurcation meets
    the curve or its own is degenerate, are located and named.

    Args:
        point: one of `branch.bifurcations`, of the kind "fold", "pd", "ns", "gr", "double_impact" or "force_zero";
            or "pitchfork" or "bp", if the second parameter keeps the symmetry of the orbits that cross. Or one of
            `branch.peaks`, a resonance for instance, which the curve follows.
        path: the second parameter.
        bounds: lowest and highest values of both parameters, by their paths.
        max_points: largest number of points in each direction.
        progress: show a bar.

    Returns:
        A dataset along `point`, in the order of the curve: both parameters by their paths, `x0`, `v0` (mass,),
        `multipliers`, `impact_speed` (event,), and `special`: "" or the name of a special point, "cusp", "1:1", "1:2",
        "1:3", "1:4" (a pair of multipliers at such a root of unity), "resonant_grazing" (a fold or period doubling at
        an impact without speed: curves of orbits of other periods begin there), "degenerate_pd" or "degenerate_ns" (the
        cubic of the normal form vanishes: the orbits that branch off turn from stable to unstable), or the kinds that
        meet, as "fold+pd". A curve of folds of doubled orbits ends at a "degenerate_pd".
        Of a peak also `peak_height`, the quantity. A curve of peaks passes the places where a maximum and a minimum meet, and
        ends where another extreme of the cycle becomes as high, "other_extreme".
        Attributes: the `kind`, and `ends`, why the curve ends on either side, for instance "bounds", or the name of
        the point beyond which the machine does not follow the orbit.

    Raises:
        ValueError: for paths or bounds that do not fit, a kind that has no curve, or if 64-bit numbers are off.
        Interrupted: after Ctrl-C, a `KeyboardInterrupt` whose `result` is the part followed so far.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        system = vx.models.wagg_bishop_a(0.8)
        orbit = vx.periodic_orbit(system, [0.18, 0.09], [0.33, 0.52])
        branch = vx.continuation(orbit, "forcing.frequency", (0.8, 1.0))
        fold = branch.bifurcations[1]
        bounds = {"forcing.frequency": (0.8, 1.1), "stops[0].position": (0.2, 0.4)}
        curve = vx.bifurcation_curve(fold, "stops[0].position", bounds)
        ```

    References:
        Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory (2004), Ch. 8-10; D. J. W. Simpson, Resonant grazing
        bifurcations in simple impacting systems, arXiv 2510.16218 and earlier work cited there.
    """
    check_type("point", point, Bifurcation, "one of `branch.bifurcations` or `branch.peaks`")
    refuse_single_precision("bifurcation_curve", point.branch.points["x0"])
    first = point.branch.path
    if first == path:
        raise ValueError(
            f"Argument `path` must be another parameter than `{path}`, along which the branch of the point runs."
        )
    if set(bounds) != {first, path}:
        raise ValueError(
            f"Argument `bounds` must be of `{first}` and another path, as in {{`{first}`: (0, 1), `{path}`: (0, 1)}}."
        )
    most = whole_number("max_points", max_points, 1)
    box = np.array([[float(as_numpy_float(a)) for a in bounds[name]] for name in (first, path)])
    defining, place = _with_second_parameter(*defining_system_of(point, *box[0]), point, path, box)
    begun = begin_curve(defining, place)
    _check_crossing(begun, path)
    peak = peak_quantity(point.quantity, defining.family.system) if isinstance(point, Peak) else None
    box = box / np.asarray(defining.family.span)[:, None]
    ends: list[str] = [EndKind.INTERRUPTED, EndKind.INTERRUPTED]

    def result_so_far() -> xr.Dataset:
        return _dataset(point, path, [*back.found[::-1], begun, *forth.found], ends)

    with tqdm(unit="point", disable=not progress) as bar, interrupt_with_result(result_so_far):
        back, forth = (Curve(point.kind, box, most, one, bar.update, peak) for one in (begun.turned(), begun))
        ends[0] = back.follow()
        ends[1] = EndKind.CLOSED if ends[0] == EndKind.CLOSED else forth.follow()
    return result_so_far()


def _with_second_parameter(
    defining: DefiningSystem, place: ExtendedCycle, point: Bifurcation, path: str, box: np.ndarray
) -> tuple[DefiningSystem, ExtendedCycle]:
    """Defining system and cycle with a second parameter."""
    family, (start,) = defining.family, starting_orbits(point.orbit)
    other = family_of(start._replace(is_admissible=True), path, *box[1])
    span = np.array([family.span, other.span])
    # A modal flow holds for matrices that neither parameter changes.
    flow = other.flow if isinstance(other.flow, TaylorFlow) else family.flow
    family = replace(family, second=path, span=span, flow=flow)
    second = np.asarray(get_parameter(start.system, path)) / other.span
    return replace(defining, family=family), place._replace(p=np.array([place.p, second], span.dtype))


def _check_crossing(begun: CurveState, path: str) -> None:
    """Refuse a branch point whose branches part when the second parameter varies."""
    if isinstance(begun.defining.condition, AtBranchPoint) and np.abs(begun.at.tangent[-1]) > NEGLIGIBLE:
        raise ValueError(
            f"The branches of this point cross by a symmetry that `{path}` breaks: they part, and it has no curve. "
            "Take a parameter that keeps the symmetry."
        )


def _dataset(point: Bifurcation, path: str, found: list[CurveState], ends: list[str]) -> xr.Dataset:
    """Dataset of the curve."""
    family = found[0].defining.family
    at = [one.at for one in found]
    plane = np.stack([one.place.p for one in at]) * family.span
    start = np.stack([one.start for one in at])
    num_events, n = max(len(one.sequence.kind) for one in found), start.shape[1] // 2
    columns = {
        point.branch.path: (("point",), plane[:, 0]),
        path: (("point",), plane[:, 1]),
        "x0": (("point", "mass"), start[:, :n]),
        "v0": (("point", "mass"), start[:, n:]),
        "multipliers": (("point", "multiplier"), np.stack([one.near.faces[0].multipliers for one in found])),
        "impact_speed": (("point", "event"), np.stack([one.speeds[:num_events] for one in at])),
        "residual": (("point",), np.array([one.residual for one in at])),
        "special": (("point",), np.array([one.special for one in found])),
    }
    named = {}
    if isinstance(point, Peak):
        columns["peak_height"] = (
            ("point",),
            np.array([float(height_of(one.defining, one.at.y)) for one in found]),
        )
        named = {"quantity": point.quantity}
    attrs = named | {"kind": point.kind, "ends": json.dumps(ends), "num_periods": int(family.num_periods)}
    ds = xr.Dataset(columns, attrs=attrs | versions()).set_coords([point.branch.path, path])
    for name, variable in ds.variables.items():
        variable.attrs = variable_attributes(str(name))
    return with_labels(ds, family.system)
