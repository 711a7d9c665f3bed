"""Quasi-periodic motions behind a Neimark-Sacker bifurcation."""

import numpy as np
import xarray as xr

from .._branches.branch import Bifurcation
from .._branches.kinds import Kind
from .._dataset_attributes import versions
from .._jax.arrays import Count, as_numpy_float, refuse_single_precision, whole_number
from .._jax.xla import padding_allowed
from .._orbits.orbit import PeriodicOrbit
from .._progress import interrupt_with_result, says_what_compiles, tqdm
from .._sweep.dataset import labelled
from .._sweep.short_names import with_labels
from .._system.parameters import machine_at
from .._trajectory.simulate import simulate_all
from .circle import growth_rates
from .family import Limits, TorusFamily, first_circle, states_at
from .section_map import SectionMap

# Largest distance of a multiplier of a strong resonance from such a root of unity.
_RESONANT = 1e-6


@says_what_compiles
@padding_allowed
def follow_torus(
    point: Bifurcation,
    bounds: tuple[float, float],
    *,
    tolerance: float = 1e-8,
    max_points: Count = 100,
    max_angles: Count = 400,
    progress: bool = True,
) -> xr.Dataset:
    """Follow the quasi-periodic motions that begin at a Neimark-Sacker bifurcation.

    In the stroboscopic section they lie on a closed curve, the invariant circle. Newton's method on its invariance finds
    it with its rotation number, whether the motions are stable or not. Pseudo-arclength continuation passes folds. The
    section lies at the phase of the load that is farthest from the impacts of the orbit at the bifurcation.

    Args:
        point: one of `branch.bifurcations`, of the kind "ns".
        bounds: lowest and highest value of the parameter of the branch.
        tolerance: largest error of a circle, in the size of the orbit: the distance between the image of the circle
            and the circle, half way between its angles.
        max_points: largest number of circles.
        max_angles: largest number of angles of a circle.
        progress: show a bar.

    Returns:
        A dataset along `point`, from the bifurcation on: the parameter by its path; `rotation_number` (point,), turns
        round the circle per cycle of the orbit at the bifurcation; positions `x` and velocities `v` (point, angle,
        mass) on the circle, at equal angles; `lyapunov_exponents` (point, exponent), per unit of time, zero along
        the circle first, then the others, largest first; `is_stable` (point,); `error` (point,); `num_angles` (point,) that it took.
        Attributes: `phase` of the section, radians, `num_periods`, forcing periods of a cycle, and `end`: "bounds";
        "locked", where the motions become periodic, with `locked_periods`, in cycles; "not_resolved", where the circle
        is no longer smooth enough for `max_angles`, as where an impact begins to graze; "not_converged", where it breaks
        up otherwise; "max_points_reached".

    Raises:
        ValueError: if the point is of another kind, for a pair of multipliers at a root of unity up to the fourth, at
            which no single circle begins, for bounds that do not contain the point, or if 64-bit numbers are off.
        Interrupted: after Ctrl-C, a `KeyboardInterrupt` whose `result` is the part followed so far.

    Example:
        ```python
        import jax, vijax as vx
        jax.config.update("jax_enable_x64", True)
        load = vx.Harmonic([1.0, 0.0], 1.65)
        stops = [vx.Stop(0, 0.11, "upper", 0.8)]
        system = vx.chain([1.0, 1.29], [0.02, 0.02], [1.0, 1.1], load, stops)
        run = vx.simulate(system, 0.0, 500 * system.forcing.period)
        branch = vx.continuation(vx.periodic_orbit(system, run.x1, run.v1), "forcing.frequency", (1.5, 1.7))
        point = next(a for a in branch.bifurcations if a.kind == "ns")
        torus = vx.follow_torus(point, (1.54, 1.6))
        ```

    References:
        F. Schilder, H. M. Osinga and W. Vogt, SIAM J. Appl. Dyn. Syst. 4, 459 (2005); A. Jorba, Nonlinearity 14, 943
        (2001).
    """
    refuse_single_precision("follow_torus", point.branch.points["x0"])
    if point.kind != Kind.NEIMARK_SACKER:
        raise ValueError(f'Argument `point` must be of the kind "ns", but is of the kind "{point.kind}".')
    low, high = sorted(float(as_numpy_float(a)) for a in bounds)
    if not low <= point.value <= high:
        raise ValueError(
            f"Argument `bounds` must contain the bifurcation at {point.value:.12g}, but is {bounds}."
        )
    section, state = _section_of(point)
    parameter = point.value / section.span
    mode, rotation = _turning_mode(section, state, parameter)
    limits = Limits(
        low / section.span,
        high / section.span,
        whole_number("max_points", max_points, 1),
        whole_number("max_angles", max_angles, 33),
        float(tolerance),
    )
    with tqdm(unit="circle", disable=not progress) as bar:
        family = TorusFamily(section, limits, bar.update)
        with interrupt_with_result(lambda: _dataset(section, family)):
            family.follow(first_circle(state, mode, rotation, parameter))
    return _dataset(section, family)


def _section_of(point: Bifurcation) -> tuple[SectionMap, np.ndarray]:
    """Map of the section farthest from the events of the orbit, and the scaled state of the orbit there."""
    orbit = point.orbit
    frequency = float(orbit.system.forcing.frequency)
    t0, later = float(orbit.phase) / frequency, _longest_rest(orbit)
    phase = float(orbit.phase) + frequency * later
    sol = simulate_all(
        orbit.system,
        t0,
        t0 + orbit.period,
        orbit.x0,
        orbit.v0,
        ts=[t0 + later],
        args=orbit.args,
        flow=orbit.flow,
        max_events=orbit.events.t.shape[-1],
    )
    state = np.concatenate([sol.xs[0], sol.vs[0]])
    n = len(state) // 2
    sizes = np.maximum(np.abs(state), np.abs(np.concatenate([orbit.x0, orbit.v0])))
    size = max(sizes[:n].max(), sizes[n:].max() / frequency)
    scale = np.repeat([size, size * frequency], n)
    own = orbit.system, point.branch.path, orbit.num_periods, phase % (2 * np.pi), orbit.flow, orbit.args
    return SectionMap(*own, scale, abs(point.value) or 1.0), state / scale


def _longest_rest(orbit: PeriodicOrbit) -> float:
    """Time from the start of the orbit to the middle of its longest flight."""
    times = np.asarray(orbit.events.t) - float(orbit.phase) / float(orbit.system.forcing.frequency)
    times = np.unique(times[np.isfinite(times)])
    if not times.size:
        return 0.0
    ahead = np.append(times, times[0] + float(orbit.period))
    k = int(np.argmax(np.diff(ahead)))
    return float((ahead[k] + ahead[k + 1]) / 2 % float(orbit.period))


def _turning_mode(section: SectionMap, state: np.ndarray, parameter: float) -> tuple[np.ndarray, float]:
    """Eigenvector of the multiplier on the unit circle, and its angle in turns."""
    multipliers, modes = np.linalg.eig(section(state[None], parameter).jacobians[0])
    k = int(np.argmin(np.abs(np.abs(multipliers) - 1) + (np.imag(multipliers) <= 0)))
    for order in range(1, 5):
        if abs(multipliers[k] ** order - 1) < _RESONANT:
            raise ValueError(
                f"The pair of multipliers lies at a root of unity of order {order}, a strong resonance: no single circle "
                "begins there. Move another parameter a little."
            )
    return modes[:, k], float(np.angle(multipliers[k]) / (2 * np.pi))


def _dataset(section: SectionMap, family: TorusFamily) -> xr.Dataset:
    found, n = family.found, len(section.scale) // 2
    num_angles = max((len(one.circle.states) for one in found), default=0)
    states = np.reshape([states_at(one.circle, num_angles) for one in found], (len(found), num_angles, 2 * n))
    values = np.array([one.circle.parameter for one in found]) * section.span
    rates = [growth_rates(one.circle, one.mapped.jacobians) for one in found]
    rates = np.reshape(rates, (len(found), 2 * n))
    times = [_cycle_time(section, value) for value in values]
    columns = {
        section.path: (("point",), values),
        "rotation_number": (("point",), np.array([one.circle.rotation for one in found])),
        "x": (("point", "angle", "mass"), (states * section.scale)[..., :n]),
        "v": (("point", "angle", "mass"), (states * section.scale)[..., n:]),
        "lyapunov_exponents": (("point", "exponent"), rates / np.reshape(times, (-1, 1))),
        "is_stable": (("point",), np.all(rates[:, 1:] < 0, axis=1)),
        "error": (("point",), np.array([one.error for one in found])),
        "num_angles": (("point",), np.array([len(one.circle.states) for one in found], int)),
    }
    attrs = {
        "path": section.path,
        "phase": section.phase,
        "num_periods": section.num_periods,
        "end": str(family.end),
    }
    if family.locked_period:
        attrs["locked_periods"] = family.locked_period
    ds = labelled(xr.Dataset(columns, attrs=attrs | versions()).set_coords(section.path))
    ds["is_stable"].attrs["long_name"] = "whether all exponents but that along the circle are negative"
    ds["error"].attrs["long_name"] = "largest distance of the circle from its image, in the size of the orbit"
    return with_labels(ds, section.system)


def _cycle_time(section: SectionMap, value: float) -> float:
    system = machine_at(section.system, section.path, value)
    return section.num_periods * float(system.forcing.period)
