"""Properties of thousands of random machines, of every kind."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vijax as vx

LAYOUTS = {
    "one_stop": (1, ((0, "upper"),)),
    "between_two_stops": (1, ((0, "upper"), (0, "lower"))),
    "two_in_a_row": (2, ((0, "upper"), (1, "upper"))),
    "two_opposed": (2, ((0, "lower"), (1, "upper"))),
    "two_between_four": (2, ((0, "lower"), (0, "upper"), (1, "upper"), (1, "lower"))),
    "three": (3, ((0, "upper"), (2, "lower"), (1, "upper"))),
    "three_between_six": (
        3,
        ((0, "upper"), (2, "lower"), (1, "upper"), (0, "lower"), (1, "lower"), (2, "upper")),
    ),
    "four": (4, ((3, "upper"), (3, "lower"), (0, "upper"), (1, "upper"))),
    "five": (5, ((0, "upper"), (2, "lower"), (4, "upper"), (1, "lower"), (3, "upper"))),
    "six": (6, ((5, "upper"), (2, "lower"), (4, "upper"), (1, "lower"), (3, "upper"), (0, "upper"))),
}
FAST = [("two_opposed", 1, 64)]
SLOW = [
    *((name, 1, 400) for name in LAYOUTS),
    ("between_two_stops", 3, 400),
    ("two_between_four", 2, 400),
    ("three_between_six", 3, 200),
]
GROUPS = [
    *(pytest.param(*g, id=f"{g[0]}-{g[1]}", marks=pytest.mark.thorough) for g in FAST),
    *(pytest.param(*g, id=f"{g[0]}-{g[1]}-many", marks=pytest.mark.slow) for g in SLOW),
]
LOG = 400
# Some ten roundings of the position.
ROUNDING = 1e-14
# Error of the cubic interpolation of a gap between samples, h^4 max|x''''| / 384.
SAMPLED_DEPTH = 1e-6


def chain_matrix(links: np.ndarray) -> np.ndarray:
    """Matrix of links in a row from the wall, as in Eqs. 1 and 2 of the paper."""
    return np.diag(links + np.append(links[1:], 0)) - np.diag(links[1:], 1) - np.diag(links[1:], -1)


def draw_matrices(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masses, damping and stiffness: chains, full matrices, rigid-body modes, up to heavy damping."""
    mass = np.ones(n) if rng.random() < 0.3 else np.exp(rng.uniform(np.log(0.2), np.log(5), n))
    links = np.exp(rng.uniform(np.log(0.2), np.log(5), n))
    if rng.random() < 0.4:
        links[rng.integers(n)] = 0.0
    root = rng.normal(size=(n, rng.integers(max(1, n - 1), n + 1)))
    stiffness = root @ root.T if rng.random() < 0.25 else chain_matrix(links)
    full = rng.normal(size=(n, rng.integers(1, n + 1)))
    damping = [
        lambda: np.zeros((n, n)),
        lambda: stiffness * 10 ** rng.uniform(-3, 0),
        lambda: np.diag(mass) * 10 ** rng.uniform(-3, 0),
        lambda: chain_matrix(10 ** rng.uniform(-2, 0, n)),
        lambda: chain_matrix(2 * 10 ** rng.uniform(0, 1) * np.sqrt(links * mass)),
        lambda: full @ full.T * 10 ** rng.uniform(-2, 0.5),
        lambda: chain_matrix(np.where(rng.random(n) < 0.5, 0, rng.uniform(0, 2, n))),
    ][rng.integers(7)]()
    return mass, (damping + damping.T) / 2, (stiffness + stiffness.T) / 2


def draw_restitution(rng: np.random.Generator, stops: int, is_damped: bool) -> np.ndarray:
    """Restitutions: plastic, elastic, equal, mixed, near either end.

    Elastic stops of damped machines are excluded: if pressed, the number of bounces grows exponentially, beyond any
    bound on steps.
    """
    r = [
        np.zeros(stops),
        np.ones(stops),
        np.full(stops, 0.7),
        rng.choice([0.0, 0.5, 1.0], stops),
        rng.uniform(0, 1, stops),
        rng.choice([1e-3, 0.01, 0.97, 0.99], stops),
        rng.uniform(0, 0.3, stops),
    ][rng.integers(7)]
    return np.where((r == 1) & is_damped, 0.9, r)


def draw_start(rng: np.random.Generator, n: int, stops: tuple, position: np.ndarray) -> tuple:
    """A start between the stops, in a third of all cases on them: moving in or out, or at rest."""
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    for (i, side), s in zip(stops, position, strict=True):
        (high if side == "upper" else low)[i] = s
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - 1, -0.5))
    high = np.where(np.isfinite(high), high, low + 1)
    x, v = rng.uniform(low, high), rng.normal(size=n) * rng.integers(0, 2)
    if rng.random() < 0.33:
        for (i, _), s in zip(stops, position, strict=True):
            if rng.random() < 0.7:
                x[i], v[i] = s, rng.choice([-1.0, 0.0, 0.0, 1.0]) * rng.uniform(0, 1)
    return x, v


def draw(rng: np.random.Generator, layout: str, harmonics: int) -> dict[str, np.ndarray]:
    """A random machine with its start and its time span."""
    n, stops = LAYOUTS[layout]
    mass, damping, stiffness = draw_matrices(rng, n)
    frequency = 10 ** rng.uniform(-1.5, 1.5)
    amplitude = rng.normal(size=(harmonics, n)) * (rng.random((harmonics, n)) < 0.7)
    signs = np.array([1 if side == "upper" else -1 for _, side in stops])
    offset = rng.normal(size=n) if rng.random() < 0.2 else np.zeros(n)
    position = signs * rng.uniform(0.02, 0.6, len(stops)) + offset[[i for i, _ in stops]]
    x0, v0 = draw_start(rng, n, stops, position)
    rate = (
        harmonics * frequency
        + np.sqrt(np.abs(stiffness).sum() / mass.min())
        + np.abs(damping).sum() / mass.min()
    )
    t0 = 0.0 if rng.random() < 0.5 else rng.uniform(-5, 50)
    return {
        "mass": mass,
        "damping": damping,
        "stiffness": stiffness,
        "amplitude": amplitude * 10 ** rng.uniform(-1, 0.5) / np.arange(1, harmonics + 1)[:, None],
        "frequency": np.array(frequency),
        "phase": rng.uniform(0, 2 * np.pi, (harmonics, n)),
        "mean": rng.normal(size=n) * (rng.random(n) < 0.5) * rng.integers(0, 2),
        "position": position,
        "restitution": draw_restitution(rng, len(stops), bool(damping.any())),
        "x0": x0,
        "v0": v0,
        "t0": np.array(t0),
        "t1": np.array(t0 + min(max(8 * 2 * np.pi / frequency, 5.0), 200 / rate)),
    }


class Batch(NamedTuple):
    """A batch of machines and its results; lanes first, as NumPy arrays."""

    machines: dict[str, np.ndarray]
    solution: vx.Solution
    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    force: np.ndarray
    signs: np.ndarray
    masses: np.ndarray

    @property
    def log(self) -> vx.EventLog:
        """Event logs."""
        return self.solution.events

    @property
    def impacts(self) -> np.ndarray:
        """True where the log has impacts."""
        return np.asarray(self.log.kind) == vx.IMPACT

    @property
    def gaps(self) -> np.ndarray:
        """Gap of every stop at every sample, (lanes, samples, stops)."""
        return self.signs * (self.machines["position"][:, None] - self.x[..., self.masses])

    @property
    def scale(self) -> np.ndarray:
        """Size of the motion of every lane."""
        return np.maximum(1, np.nanmax(np.abs(self.x), axis=(1, 2)))


def sample_times(machines: dict[str, np.ndarray], restarts: np.ndarray) -> np.ndarray:
    """Dense times, and times inside every flight between events, even short ones, as far as there is room."""
    rows = []
    for t0, t1, row in zip(machines["t0"], machines["t1"], restarts, strict=True):
        ends = np.append(row[np.isfinite(row)][:60], t1)
        flights = [ends[:-1] + f * np.diff(ends) for f in (0.0, 0.01, 0.5, 0.99)]
        inside = np.resize(np.concatenate(flights), 240)
        rows.append(np.clip(np.sort(np.append(np.linspace(t0, t1, 160), inside)), t0, t1))
    return np.array(rows)


@cache
def simulate(layout: str, harmonics: int, lanes: int) -> Batch:
    n, stops = LAYOUTS[layout]
    rng = np.random.default_rng([n, len(stops), harmonics, lanes])
    drawn = [draw(rng, layout, harmonics) for _ in range(lanes)]
    machines = {name: np.stack([d[name] for d in drawn]) for name in drawn[0]}

    @jax.jit
    @jax.vmap
    def run(m):
        load = vx.Harmonic(m["amplitude"], m["frequency"], m["phase"], m["mean"])
        walls = [vx.Stop(i, m["position"][j], side, m["restitution"][j]) for j, (i, side) in enumerate(stops)]
        system = vx.ImpactSystem(m["mass"], m["damping"], m["stiffness"], load, walls)
        return vx.simulate(system, m["t0"], m["t1"], m["x0"], m["v0"], max_events=LOG, throw=False)

    solution = run(jax.tree.map(jnp.asarray, machines))
    t = sample_times(machines, np.asarray(solution.restarts.t))
    (x, v), force = jax.jit(jax.vmap(lambda s, t: (s.evaluate(t), s.contact_force(t))))(
        solution, jnp.asarray(t)
    )
    signs = np.array([1 if side == "upper" else -1 for _, side in stops])
    masses = np.array([i for i, _ in stops])
    return Batch(machines, solution, t, np.asarray(x), np.asarray(v), np.asarray(force), signs, masses)


@pytest.fixture
def batch(layout, harmonics, lanes):
    return simulate(layout, harmonics, lanes)


for_every_group = pytest.mark.parametrize(("layout", "harmonics", "lanes"), GROUPS)


@pytest.mark.slow
@for_every_group
def test_every_lane_reaches_its_end_with_numbers(batch):
    result = batch.solution.result
    is_done = np.asarray((result == vx.RESULTS.successful) | (result == vx.RESULTS.max_events_reached))
    assert is_done.all(), f"lanes {np.flatnonzero(~is_done)} did not"
    for state in (batch.solution.x1, batch.solution.v1):
        assert np.isfinite(state).all()
    unknown = np.isnan(batch.x).any(axis=(1, 2)) & np.asarray(result == vx.RESULTS.successful)
    assert not unknown.any(), f"lanes {np.flatnonzero(unknown)} cannot be evaluated everywhere"


@for_every_group
def test_no_sample_lies_beyond_a_stop(batch):
    depth = -np.nanmin(batch.gaps, axis=(1, 2)) / batch.scale
    assert (depth <= ROUNDING).all(), (
        f"lanes {np.flatnonzero(depth > ROUNDING)} penetrate by {depth.max():.1e}"
    )


@for_every_group
def test_no_gap_dips_below_zero_between_two_samples(batch):
    # Cubic through the values and slopes at both ends, where they imply a minimum between them.
    gap, slope = batch.gaps, -batch.signs * batch.v[..., batch.masses]
    h = np.diff(batch.t, axis=1)[..., None]
    start, end, falls, rises = gap[:, :-1], gap[:, 1:], h * slope[:, :-1], h * slope[:, 1:]
    events = np.asarray(batch.solution.restarts.t)
    is_flight = np.array(
        [np.diff(np.searchsorted(e, t, "right")) == 0 for e, t in zip(events, batch.t, strict=True)]
    )
    has_minimum = (falls < 0) & (rises > 0) & is_flight[..., None]
    for u in np.linspace(0.1, 0.9, 9):
        weights = (1 + 2 * u) * (1 - u) ** 2, u * (1 - u) ** 2, u * u * (3 - 2 * u), -u * u * (1 - u)
        between = sum(w * a for w, a in zip(weights, (start, falls, end, rises), strict=True))
        depth = np.max(np.where(has_minimum, -between, -np.inf), axis=(1, 2)) / batch.scale
        assert (depth <= SAMPLED_DEPTH).all(), f"lanes {np.flatnonzero(depth > SAMPLED_DEPTH)}"


@for_every_group
def test_every_impact_is_towards_its_stop_and_obeys_the_restitution_law(batch):
    assert batch.impacts.sum() > 5 * len(batch.impacts)
    lane, _ = np.nonzero(batch.impacts)
    stop = np.asarray(batch.log.stop)[batch.impacts]
    before, after = (
        np.asarray(v)[batch.impacts] for v in (batch.log.velocity_minus, batch.log.velocity_plus)
    )
    assert (batch.signs[stop] * before > 0).all()
    np.testing.assert_array_equal(after, -batch.machines["restitution"][lane, stop] * before)
    mass = batch.machines["mass"][lane, batch.masses[stop]]
    impulse = np.asarray(batch.log.impulse)[batch.impacts]
    np.testing.assert_allclose(impulse, mass * (after - before), rtol=1e-14)


@for_every_group
def test_every_log_is_sorted_and_padded_after_its_count(batch):
    count, kind = np.asarray(batch.solution.num_events), np.asarray(batch.log.kind)
    is_event = np.arange(LOG) < count[:, None]
    np.testing.assert_array_equal(kind >= 0, is_event)
    np.testing.assert_array_equal(np.asarray(batch.log.stop) >= 0, is_event)
    t = np.asarray(batch.log.t)
    np.testing.assert_array_equal(np.isfinite(t), is_event)
    assert (np.diff(t, axis=1)[is_event[:, 1:]] >= 0).all()
    assert (t[is_event] >= np.repeat(batch.machines["t0"], count)).all()


@for_every_group
def test_every_stop_sticks_and_releases_in_turn(batch):
    was_held = np.asarray(batch.solution.restarts.held)[:, 0]
    for lane, (kinds, stops) in enumerate(zip(batch.log.kind, batch.log.stop, strict=True)):
        for j, held in enumerate(was_held[lane]):
            run = np.asarray(kinds)[np.asarray(stops) == j]
            changes = run[run != vx.IMPACT]
            expected = np.resize([vx.RELEASE, vx.STICK] if held else [vx.STICK, vx.RELEASE], len(changes))
            np.testing.assert_array_equal(changes, expected, err_msg=f"lane {lane}, stop {j}")
            # No impact while it sticks: a stick is followed by its release.
            assert not (np.diff(run) == vx.IMPACT - vx.STICK).any(), f"lane {lane}, stop {j}"


@for_every_group
def test_a_held_mass_rests_on_its_stop_and_presses(batch):
    is_held = batch.force > 0
    assert is_held.any()
    x, v = batch.x[..., batch.masses], batch.v[..., batch.masses]
    position = np.broadcast_to(batch.machines["position"][:, None], x.shape)
    np.testing.assert_array_equal(x[is_held], position[is_held])
    assert not v[is_held].any()
    size = np.nanmax(np.abs(batch.force), axis=(1, 2))
    assert (np.nanmin(batch.force, axis=(1, 2)) >= -ROUNDING * np.maximum(1, size)).all()
    held_at_end = np.asarray(batch.solution.stuck1)
    assert not np.asarray(batch.solution.v1)[:, batch.masses][held_at_end].any()


def test_a_mass_at_rest_on_its_stop_is_held_once_the_hit_of_another_presses_it():
    # The damper between the masses pulls mass 1 off its stop, until at the same instant mass 0 is stopped. Then only
    # the load of 0.2 acts, towards the stop.
    load = vx.Harmonic([0.0, 0.0], 1.0, mean=[0.0, 0.2])
    stops = [vx.Stop(0, 0.0, "lower", 0.0), vx.Stop(1, 0.0, "upper", 0.0)]
    system = vx.ImpactSystem([1.0, 1.0], [[1.0, -1.0], [-1.0, 1.0]], np.eye(2), load, stops)
    start = np.zeros(2), np.array([-1.0, 0.0])
    sol = vx.simulate(system, 0.0, 1.0, *start, ts=np.linspace(0.0, 1.0, 6), max_events=16)
    np.testing.assert_array_equal(sol.xs[:, 1], 0.0)
    assert sol.stuck1[1]
    # It did not stick before that instant, so the log has a stick.
    first = (sol.events.stop == 1) & (sol.events.kind == vx.STICK)
    np.testing.assert_array_equal(sol.events.t[first], [0.0])


def test_a_mass_without_any_spring_falls_and_comes_to_rest():
    # The only stiffness is zero: neither a mode nor a static deflection exists.
    load = vx.Harmonic([0.0], 8.0, mean=[-1.0])
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], load, [vx.Stop(0, 0.0, "lower", 0.5)])
    sol = vx.simulate(system, 0.0, 5.0, np.array([1.0]), max_events=64)
    # Flights of 2 v / g with v = sqrt(2), halved each time: sqrt(2) + 2 sqrt(2) (1/2 + 1/4 + ...).
    stick = sol.events.t[sol.events.kind == vx.STICK]
    np.testing.assert_allclose(stick, [3 * np.sqrt(2)], rtol=1e-12)
    assert sol.x1[0] == 0
