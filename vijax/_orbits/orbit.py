"""The result of `periodic_orbit`."""

from typing import Any

import equinox as eqx
import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Complex, Float, Int

from .._dataset_attributes import flags, versions
from .._descriptions import described_by
from .._flow.interface import AbstractFlow
from .._hybrid.limits import EVENT_NAMES
from .._jax.arrays import Scalar
from .._jax.concrete import concrete
from .._printing import describe_orbit
from .._sweep.dataset import labelled
from .._system.symmetry import Symmetry
from .._system.system import AnySystem
from .._trajectory.event_log import EventLog
from .._trajectory.simulate import simulate
from .._trajectory.solution import Solution


class ORBIT_RESULTS(eqx.Enumeration):  # as `RESULTS`
    """Results of the search for an orbit, each with a message that says what to do."""

    successful = "successful: the orbit was found, and the machine follows it."
    not_converged = (
        "not_converged: no cycle was found near the guess. Start from a better one, such as the end of a long "
        "`vx.simulate` or a point of `vx.sweep`, or ask for another `num_periods`."
    )
    left_the_stops = (
        "left_the_stops: a cycle was found, but no motion of the machine: it passes through a stop, meets one from "
        "behind, or is held where it is pulled. Start from another guess, or with `throw=False` take it for what it is."
    )
    drifts = (
        "drifts: nothing holds the masses together along some direction, in which the load has a mean, so that they drift for "
        "ever. Take that mean away, or hold a mass by a spring."
    )
    max_events_reached = "max_events_reached: there are more events in so many periods than there is room for. Increase `max_events`."


class PeriodicOrbit(eqx.Module):
    """A motion that repeats after n forcing periods.

    Attributes:
        system: the machine, or the family at the values of the orbit.
        num_periods: n; 0 for the cycle of a machine that nothing drives.
        period: n forcing periods as a time, or that of such a cycle.
        phase: phase of the load at its start, in radians.
        x0: positions there, (n,).
        v0: velocities there, (n,).
        events: the events of one cycle.
        progression: displacement of the masses over one cycle, (n,): zero unless nothing but friction holds them, as in a
            capsule robot, which then repeats up to it.
        num_impacts: impacts in one cycle, (stops,); of a chatter all that were followed.
        multipliers: Floquet multipliers, (2 n,), complex, the largest magnitude first. Two are zero for every mass that
            sticks, one where friction does; one is infinite where the orbit grazes; one is 1 along a cycle that nothing drives, and one for every shift of the masses that no spring and no
            contact resists, and for every Jenkins element that sticks all along: its slider may be anywhere, and stays where the
            guess has it.
        is_stable: whether all multipliers lie inside the unit circle, but for those of shifts by which the orbit progresses,
            and the one along a cycle that nothing drives.
        is_admissible: whether the machine follows it: run from x0 and v0, it shows the same events.
        residual: closing error of the cycle, relative to the size of the motion.
        num_runs: number of runs of the motion in the search.
        result: outcome of the search, a member of `vx.ORBIT_RESULTS`.
    """

    system: AnySystem
    num_periods: int = eqx.field(static=True)
    period: Scalar
    phase: Scalar
    x0: Float[Array, " n"]
    v0: Float[Array, " n"]
    events: EventLog
    progression: Float[Array, " n"]
    num_impacts: Int[Array, " stops"]
    multipliers: Complex[Array, " state"]
    is_stable: Bool[Array, ""]
    is_admissible: Bool[Array, ""]
    residual: Scalar
    num_runs: Int[Array, ""]
    result: ORBIT_RESULTS
    args: object
    flow: AbstractFlow | None

    def solution(self) -> Solution:
        """Simulate one cycle of the orbit, for plots.

        Example:
            ```python
            import jax, vijax as vx
            jax.config.update("jax_enable_x64", True)
            orbit = vx.periodic_orbit(vx.models.wagg_bishop_a(0.8), [0.18, 0.09], [0.33, 0.52])
            vx.plot.phase_portrait(orbit.solution())
            ```
        """
        t0 = self.phase / self.system.forcing.frequency if self.num_periods else 0 * self.period
        max_events = self.events.t.shape[-1]
        return simulate(
            self.system,
            t0,
            t0 + self.period,
            self.x0,
            self.v0,
            args=self.args,
            flow=self.flow,
            max_events=max_events,
        )

    def symmetries(self) -> tuple[Symmetry, ...]:
        """Find the symmetries of the machine that the orbit has: they map it to itself, shifted in time.

        A mass between two equal stops has orbits that are the same on both sides, half a period later, and pairs of orbits
        that are mirror images of each other.

        Returns:
            Those of `orbit.system.symmetries()` that the orbit has.

        Raises:
            ValueError: for an orbit that the machine does not follow, or a traced one.

        Example:
            ```python
            import jax, vijax as vx
            jax.config.update("jax_enable_x64", True)
            stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
            machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 2.0), stops)
            sol = vx.simulate(machine, 0.0, 300 * machine.forcing.period, [0.1], max_events=8, throw=False)
            vx.periodic_orbit(machine, sol.x1, sol.v1).symmetries()  # x0 -> -x0, half a period later
            ```
        """
        from .orbit_symmetry import symmetries_of_orbit  # which needs this class

        return symmetries_of_orbit(self)

    def mirrored(self, symmetry: Symmetry | None = None) -> "PeriodicOrbit":
        """Find the image of the orbit under a symmetry of the machine.

        An orbit without a symmetry of its machine has a mirror image: another orbit of the same period, multipliers and
        stability.

        Args:
            symmetry: one of `orbit.system.symmetries()`; the first that the orbit has not, if left out. An orbit that has all
                of them is its own image.

        Returns:
            The image, at the same phase of the load.

        Raises:
            ValueError: for a machine without symmetry, an orbit that the machine does not follow, or a traced one.

        Example:
            ```python
            import jax, vijax as vx
            jax.config.update("jax_enable_x64", True)
            stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.Stop(0, -0.5, "lower", 0.8)]
            machine = vx.ImpactSystem([1.0], [[0.1]], [[1.0]], vx.Harmonic([1.0], 1.5), stops)
            sol = vx.simulate(machine, 0.0, 300 * machine.forcing.period, [0.1], max_events=8, throw=False)
            other = vx.periodic_orbit(machine, sol.x1, sol.v1).mirrored()
            ```
        """
        from .orbit_symmetry import image_of_orbit  # which needs this class

        return image_of_orbit(self, symmetry)

    def to_xarray(self) -> xr.Dataset:
        """Label the orbit: the state at its start, its events, its multipliers.

        Returns:
            A dataset of `x0`, `v0` (mass,), `multiplier_real`, `multiplier_imag` (multiplier,), the events (event,) as
            `Solution.to_xarray` has them, `num_impacts` (stop,), and the other attributes of this class.
        """
        if concrete(self.period) is None or self.period.ndim:
            raise ValueError("`to_xarray` labels one orbit, outside of `jax.jit` and `jax.vmap`.")
        return _dataset(self)

    __repr__, _repr_html_ = described_by(describe_orbit, tuple(ORBIT_RESULTS._name_to_item), EVENT_NAMES)


def _dataset(orbit: PeriodicOrbit) -> xr.Dataset:
    log, multipliers = orbit.events, np.asarray(orbit.multipliers)
    is_event = np.asarray(log.kind) >= 0
    names = ("stop", "kind", "velocity_minus", "velocity_plus", "impulse")
    events = {"event_time": log.t} | {f"event_{name}": getattr(log, name) for name in names}
    single = ("period", "phase", "residual", "is_stable", "is_admissible")
    columns: dict[str, tuple[tuple[str, ...], Any]] = {
        "x0": (("mass",), orbit.x0),
        "v0": (("mass",), orbit.v0),
        "progression": (("mass",), orbit.progression),
        "multiplier_real": (("multiplier",), np.real(multipliers)),
        "multiplier_imag": (("multiplier",), np.imag(multipliers)),
        "num_impacts": (("stop",), orbit.num_impacts),
        **{name: (("event",), np.asarray(a)[is_event]) for name, a in events.items()},
        **{name: ((), getattr(orbit, name)) for name in single},
        "num_periods": ((), orbit.num_periods),
        "result": ((), orbit.result._value),
    }
    variables = {name: (dims, np.asarray(a)) for name, (dims, a) in columns.items()}
    ds = labelled(xr.Dataset(variables, attrs=versions()))
    for name, meanings in (("event_kind", EVENT_NAMES), ("result", tuple(ORBIT_RESULTS._name_to_item))):
        ds[name] = ds[name].astype(np.int8)
        ds[name].attrs |= flags(meanings)
    return ds
