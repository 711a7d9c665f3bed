"""What one would take instead of vijax: heyoka, SciPy, diffrax with events, and a scalar C++ program.

Every peer is a function of a scene and a tolerance that returns another one, which runs it and returns
its impacts as (time, stop) pairs. The three solvers stop at an impact, reverse the velocity and go on, as
their manuals show; they know no sticking. A run is given up after `LIMIT` impacts.
"""

# The peers are optional, and missing where only the library is installed.
# pyright: reportMissingImports=false

import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

Impacts = list[tuple[float, int]]
Run = Callable[[], Impacts]
LIMIT = 2000
SOURCE = Path(__file__).parent / "scalar_reference.cpp"


class Machine:
    """The equations of motion of a scene, y = (x, v), and its stops."""

    def __init__(self, scene: dict):
        self.n = scene["n"]
        self.mass, self.damping = np.array(scene["M"]), np.array(scene["C"])
        self.stiffness, self.load = np.array(scene["K"]), np.array(scene["A"])
        self.frequency, self.phase = scene["Omega"], np.array(scene["phase"])
        self.stops = [
            (s["mass"], s["position"], 1 if s["side"] == "upper" else -1, s["restitution"])
            for s in scene["stops"]
        ]
        self.start = np.array([*scene["x0"], *scene["v0"]], float)
        self.t0, self.t1 = scene["t0"], scene["t1"]

    def rate(self, t, y, xp=np):
        """Time derivative of y."""
        x, v = y[: self.n], y[self.n :]
        load = self.load * xp.cos(self.frequency * t + self.phase)
        return xp.concatenate([v, (load - self.damping @ v - self.stiffness @ x) / self.mass])


def scipy(scene: dict, tolerance: float) -> Run:
    """DOP853 of SciPy with terminal events."""
    from scipy.integrate import solve_ivp

    machine = Machine(scene)
    events = []
    for mass, position, sign, _ in machine.stops:

        def gap(t, y, mass=mass, position=position, sign=sign):
            return sign * (position - y[mass])

        gap.terminal, gap.direction = True, -1
        events.append(gap)

    def run() -> Impacts:
        t, y, impacts = machine.t0, machine.start, []
        while t < machine.t1 and len(impacts) < LIMIT:
            sol = solve_ivp(
                machine.rate, (t, machine.t1), y, "DOP853", rtol=tolerance, atol=tolerance, events=events
            )
            t, y = sol.t[-1], sol.y[:, -1].copy()
            for j, times in enumerate(sol.t_events):
                if len(times) and sol.status == 1:
                    mass, position, _, restitution = machine.stops[j]
                    y[mass], y[machine.n + mass] = position, -restitution * y[machine.n + mass]
                    impacts.append((t, j))
        return impacts

    return run


def heyoka(scene: dict, tolerance: float) -> Run:
    """Heyoka's adaptive Taylor method with terminal events."""
    import heyoka as hy

    machine, impacts = Machine(scene), []
    names = [f"{kind}{i}" for kind in "xv" for i in range(machine.n)]
    y = hy.make_vars(*names)
    x, v = y[: machine.n], y[machine.n :]
    rates = list(v)
    for i in range(machine.n):
        force = machine.load[i] * hy.cos(machine.frequency * hy.time + machine.phase[i])
        for k in range(machine.n):
            force = force - machine.damping[i, k] * v[k] - machine.stiffness[i, k] * x[k]
        rates.append(force / machine.mass[i])

    class Rebound:
        def __init__(self, j: int):
            self.j = j

        def __call__(self, ta, d_sgn):
            mass, _, _, restitution = machine.stops[self.j]
            ta.state[machine.n + mass] *= -restitution
            impacts.append((float(ta.time), self.j))
            return len(impacts) < LIMIT

    directions = {1: hy.event_direction.positive, -1: hy.event_direction.negative}
    events = [
        hy.t_event(x[mass] - position, callback=Rebound(j), direction=directions[sign])
        for j, (mass, position, sign, _) in enumerate(machine.stops)
    ]
    ta = hy.taylor_adaptive(
        list(zip(y, rates, strict=True)), machine.start, time=machine.t0, t_events=events, tol=tolerance
    )

    def run() -> Impacts:
        impacts.clear()
        ta.time, ta.state[:] = machine.t0, machine.start
        ta.reset_cooldowns()
        ta.propagate_until(machine.t1, max_steps=100_000)
        return list(impacts)

    return run


def heyoka_sweep(stops: tuple[float, float, float], frequencies: np.ndarray, tolerance: float) -> float:
    """Run a sweep of a paper case, 120 periods, on one core; return the time without the compilation."""
    import heyoka as hy

    x1, x2, v1, v2 = hy.make_vars("x1", "x2", "v1", "v2")
    load = stops[2] * hy.cos(hy.par[0] * hy.time)
    a1 = load - 2 * x1 + x2 - 0.1 * (2 * v1 - v2)
    rates = [(x1, v1), (x2, v2), (v1, a1), (v2, x1 - x2 - 0.1 * (v2 - v1))]

    class Rebound:
        def __init__(self, i: int):
            self.i = i

        def __call__(self, ta, d_sgn):
            ta.state[2 + self.i] *= -0.7
            return True

    directions = [hy.event_direction.positive if s > 0 else hy.event_direction.negative for s in stops[:2]]
    events = [
        hy.t_event(x - s, callback=Rebound(i), direction=d)
        for i, (x, s, d) in enumerate(zip((x1, x2), stops, directions, strict=False))
    ]
    ta = hy.taylor_adaptive(rates, [0.0] * 4, pars=[1.0], t_events=events, tol=tolerance)
    start = time.perf_counter()
    for frequency in frequencies:
        ta.time, ta.state[:], ta.pars[0] = 0.0, 0.0, frequency
        ta.reset_cooldowns()
        ta.propagate_until(240 * np.pi / frequency)
    return time.perf_counter() - start


def diffrax(scene: dict, tolerance: float) -> Run:
    """Dopri8 of diffrax with `Event`, compiled once, restarted from Python at every impact."""
    import diffrax as dfx
    import jax
    import jax.numpy as jnp
    import optimistix as optx

    machine = Machine(scene)
    term = dfx.ODETerm(lambda t, y, args: machine.rate(t, y, jnp))
    controller = dfx.PIDController(rtol=tolerance, atol=tolerance)

    def gap(j: int) -> Callable:
        mass, position, sign, _ = machine.stops[j]
        return lambda t, y, args, **kwargs: sign * (position - y[mass])

    gaps = [gap(j) for j in range(len(machine.stops))]
    event = dfx.Event(gaps, optx.Newton(1e-12, 1e-12), direction=[False] * len(gaps))

    @jax.jit
    def fly(t, y):
        sol = dfx.diffeqsolve(
            term, dfx.Dopri8(), t, machine.t1, None, y, stepsize_controller=controller, event=event,
            max_steps=100_000, throw=False,
        )  # fmt: skip
        assert sol.ts is not None
        assert sol.ys is not None
        return sol.ts[-1], sol.ys[-1], jnp.stack(jax.tree.leaves(sol.event_mask))

    def run() -> Impacts:
        t, y, impacts = machine.t0, machine.start, []
        while t < machine.t1 and len(impacts) < LIMIT:
            t, y, mask = (np.array(a) for a in fly(t, y))
            if not mask.any():
                break
            j = int(np.argmax(mask))
            mass, position, _, restitution = machine.stops[j]
            y[mass], y[machine.n + mass] = position, -restitution * y[machine.n + mass]
            impacts.append((float(t), j))
        return impacts

    return run


def build_scalar(folder: Path) -> Path | None:
    """Compile the scalar C++ program, if there is a compiler."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        return None
    program = folder / "scalar_reference"
    command = [compiler, "-O3", "-march=native", "-ffast-math", "-o", str(program), str(SOURCE)]
    subprocess.run(command, check=True)
    return program


def scalar_sweep(
    program: Path, stops: tuple[float, float, float], frequencies: np.ndarray, cores: int
) -> None:
    """Run a sweep of a paper case, 100 + 20 periods, by the scalar program: one process a core."""
    processes = []
    for k in range(cores):
        share = frequencies[k::cores]
        arguments = [
            *map(repr, map(float, (*stops, share[0], share[-1]))),
            str(len(share)),
            "100",
            "20",
            "1.5",
            "0",
        ]
        processes.append(subprocess.Popen([program, *arguments], stderr=subprocess.DEVNULL))
    for process in processes:
        process.wait()


def scalar_impacts(program: Path, scene: dict) -> Impacts:
    """The impacts of a scene of the paper's two-mass chain by the scalar program."""
    positions = [s["position"] for s in sorted(scene["stops"], key=lambda s: s["mass"])]
    periods = int(np.ceil(scene["t1"] * scene["Omega"] / (2 * np.pi)))
    numbers = (*positions, scene["A"][0], scene["Omega"], scene["Omega"])
    arguments = [*map(repr, map(float, numbers)), "1", "0", str(periods), "1.5", "2"]
    text = subprocess.run([program, *arguments], check=True, capture_output=True, text=True).stdout
    rows = [line.split() for line in text.splitlines()]
    return [(float(t), int(i)) for i, t in rows if float(t) <= scene["t1"]]
