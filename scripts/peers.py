"""What one would take instead of vijax: heyoka, SciPy.

Every peer makes of a scene (and a tolerance) a `Program`. They stop at an impact, reverse the velocity and go
on, as their manuals show; they know no sticking. A run is given up after `LIMIT` impacts. A peer that is not
installed raises an ImportError. diffrax with events is in benchmarks/diffeqsolve.py, the scalar C++ program
in benchmarks/cpp.py.
"""

# The peers are optional, and missing where only the library is installed.
# pyright: reportMissingImports=false

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from benchmarks.scenes import RECORD, TRANSIENT, Outcome, Program, Scene
from benchmarks.timing import repeated

LIMIT = 1000


class Machine:
    """The equations of motion of a scene, y = (x, v), and its stops; with `forces` each mass has a cubic spring."""

    def __init__(self, scene: Scene):
        self.n = scene["n"]
        self.mass, self.damping = np.array(scene["M"]), np.array(scene["C"])
        self.stiffness, self.load = np.array(scene["K"]), np.array(scene["A"])
        self.cubic = np.array([force["numbers"]["k3"] for force in scene.get("forces", ())])
        self.frequency, self.phase = scene["Omega"], np.array(scene["phase"])
        self.stops = [
            (s["mass"], s["position"], 1 if s["side"] == "upper" else -1, s["restitution"])
            for s in scene["stops"]
        ]
        self.start = np.array([*scene["x0"], *scene["v0"]], float)
        self.t0, self.t1 = scene["t0"], scene["t1"]

    def rate(self, t, y):
        """Time derivative of y."""
        x, v = y[: self.n], y[self.n :]
        load = self.load * np.cos(self.frequency * t + self.phase)
        springs = self.stiffness @ x + (self.cubic * x**3 if self.cubic.size else 0.0)
        return np.concatenate([v, (load - self.damping @ v - springs) / self.mass])


def scipy(scene: Scene, tolerance: float) -> Program:
    """DOP853 of SciPy with terminal events."""
    from scipy.integrate import solve_ivp

    machine = Machine(scene)
    events = []
    for mass, position, sign, _ in machine.stops:

        def gap(t, y, mass=mass, position=position, sign=sign):
            return sign * (position - y[mass])

        gap.terminal, gap.direction = True, -1
        events.append(gap)

    def run() -> Outcome:
        t, y, impacts = machine.t0, machine.start, []
        while t < machine.t1 and len(impacts) < LIMIT:
            sol = solve_ivp(
                machine.rate, (t, machine.t1), y, "DOP853", rtol=tolerance, atol=tolerance, events=events
            )
            t, y = sol.t[-1], sol.y[:, -1].copy()
            for j, found in enumerate(sol.t_events):
                if len(found) and sol.status == 1:
                    mass, position, _, restitution = machine.stops[j]
                    impacts.append((float(t), j, float(y[machine.n + mass])))
                    y[mass], y[machine.n + mass] = position, -restitution * y[machine.n + mass]
        return Outcome(impacts, y, len(impacts) == LIMIT)

    return Program(run, repeated(run))


def heyoka(scene: Scene, tolerance: float, number: type = float) -> Program:
    """Heyoka's adaptive Taylor method with terminal events; `number` may be `np.longdouble`."""
    import heyoka as hy

    machine, impacts = Machine(scene), []
    y = hy.make_vars(*(f"{kind}{i}" for kind in "xv" for i in range(machine.n)))
    x, v = y[: machine.n], y[machine.n :]
    rates = list(v)
    for i in range(machine.n):
        force = number(machine.load[i]) * hy.cos(
            number(machine.frequency) * hy.time + number(machine.phase[i])
        )
        for k in range(machine.n):
            force -= number(machine.damping[i, k]) * v[k] + number(machine.stiffness[i, k]) * x[k]
        if machine.cubic.size:
            force -= number(machine.cubic[i]) * x[i] * x[i] * x[i]
        rates.append(force / number(machine.mass[i]))

    class Rebound:
        def __init__(self, j: int):
            self.j = j

        def __call__(self, ta, d_sgn):
            mass, _, _, restitution = machine.stops[self.j]
            impacts.append((float(ta.time), self.j, float(ta.state[machine.n + mass])))
            ta.state[machine.n + mass] *= -number(restitution)
            return len(impacts) < LIMIT

    directions = {1: hy.event_direction.positive, -1: hy.event_direction.negative}
    events = [
        hy.t_event(
            x[mass] - number(position), callback=Rebound(j), direction=directions[sign], fp_type=number
        )
        for j, (mass, position, sign, _) in enumerate(machine.stops)
    ]
    start = machine.start.astype(number)
    ta = hy.taylor_adaptive(
        list(zip(y, rates, strict=True)), start, time=number(machine.t0), t_events=events,
        tol=number(tolerance), fp_type=number,
    )  # fmt: skip

    def run() -> Outcome:
        impacts.clear()
        ta.time, ta.state[:] = number(machine.t0), start
        ta.reset_cooldowns()
        ta.propagate_until(number(machine.t1), max_steps=100_000)
        return Outcome(list(impacts), ta.state.copy(), len(impacts) == LIMIT)

    return Program(run, repeated(run))


# State, its rates with the frequency as the parameter, and for each stop its mass, position, direction and restitution.
Equations = tuple[list, list, list[tuple[int, float, int, float]]]


def wagg_bishop(stops: tuple[float, float, float]) -> Equations:
    """A case of the paper: the positions of both stops and the amplitude of the load."""
    import heyoka as hy

    x1, x2, v1, v2 = hy.make_vars("x1", "x2", "v1", "v2")
    load = stops[2] * hy.cos(hy.par[0] * hy.time)
    a1 = load - 2 * x1 + x2 - 0.1 * (2 * v1 - v2)
    found = [(i, s, 1 if s > 0 else -1, 0.7) for i, s in enumerate(stops[:2])]
    return [x1, x2, v1, v2], [v1, v2, a1, x1 - x2 - 0.1 * (v2 - v1)], found


def duffing(scene: Scene) -> Equations:
    """The machine of a scene of one mass with a cubic spring."""
    import heyoka as hy

    machine, (x, v) = Machine(scene), hy.make_vars("x", "v")
    force = machine.load[0] * hy.cos(hy.par[0] * hy.time) - machine.damping[0, 0] * v
    force -= machine.stiffness[0, 0] * x + machine.cubic[0] * x * x * x
    return [x, v], [v, force / machine.mass[0]], machine.stops


def heyoka_sweep(
    build: Callable[[], Equations], frequencies: np.ndarray, tolerance: float, cores: int, repeats: int
) -> list[float]:
    """Run a sweep of the paper on all cores, a process on each, its share of the frequencies in turn.

    Returns:
        For each repeat the seconds of the slowest process, without its start and its compilation.
    """
    import heyoka as _  # noqa: F401 - to say at once that it is missing

    with ProcessPoolExecutor(cores, multiprocessing.get_context("spawn")) as pool:
        shares = [frequencies[k::cores] for k in range(cores)]
        jobs = [pool.submit(_heyoka_share, build, share, tolerance, repeats) for share in shares]
        return np.max([job.result() for job in jobs], axis=0).tolist()


def _heyoka_share(
    build: Callable[[], Equations], frequencies: np.ndarray, tolerance: float, repeats: int
) -> list[float]:
    """Seconds of some frequencies on one core."""
    run = heyoka_points(build, frequencies, TRANSIENT + RECORD, tolerance)
    return repeated(run)(repeats)


def heyoka_points(
    build: Callable[[], Equations], frequencies: np.ndarray, periods: int, tolerance: float
) -> Callable[[], int]:
    """Motions from rest over some forcing periods: one compiled integrator, the frequency a parameter of it.

    Returns:
        A function that runs them and counts their impacts.
    """
    import heyoka as hy

    y, rates, stops = build()
    count = [0]

    class Rebound:
        def __init__(self, mass: int, restitution: float):
            self.speed, self.restitution = len(y) // 2 + mass, restitution

        def __call__(self, ta, d_sgn):
            ta.state[self.speed] *= -self.restitution
            count[0] += 1
            return True

    directions = {1: hy.event_direction.positive, -1: hy.event_direction.negative}
    events = [
        hy.t_event(y[mass] - position, callback=Rebound(mass, restitution), direction=directions[sign])
        for mass, position, sign, restitution in stops
    ]
    ta = hy.taylor_adaptive(
        list(zip(y, rates, strict=True)), [0.0] * len(y), pars=[1.0], t_events=events, tol=tolerance
    )

    def run() -> int:
        count[0] = 0
        for frequency in frequencies:
            ta.time, ta.state[:], ta.pars[0] = 0.0, 0.0, frequency
            ta.reset_cooldowns()
            ta.propagate_until(periods * 2 * np.pi / frequency)
        return count[0]

    return run
