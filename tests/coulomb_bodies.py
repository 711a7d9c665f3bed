"""Machines with friction of contacts and Jenkins elements, integrated independently of vijax.

Between events the motion of a set of modes is a Taylor series, every guard is a polynomial, and its first zero is found by dense
samples and bisection. At an event all sets of modes are tried: one stands if the first derivative that is not zero of each of
its guards is positive. Impacts try all sets of contacts that push and of friction that sticks or slips (Moreau's form of
Newton's law); bounces are followed down to a speed of 1e-9. No number is shared with the package; it is slow.

Friction along one row is one element, whichever contacts press it: |T| <= sum of mu_i N_i.
"""

import itertools

import numpy as np
from coulomb_flow import ORDER, Bodies, Flow
from resting_bodies import Rigid

# Speeds and gaps, in machines of size one, that are zero; speed below which an impact has no rebound.
ZERO, SLOWEST = 1e-11, 1e-9


class Undecided(Exception):
    """No choice, or more than one, agrees with the laws, or events come too often."""


class Run:
    """A motion from a start, by `until`."""

    def __init__(self, bodies: Bodies, x0, v0):
        self.bodies, self.n = bodies, len(bodies.mass)
        self.size = 2 * self.n + len(bodies.sliders) + 3
        self.one = np.eye(self.size)[-1]
        starts = [s.start for s in bodies.sliders]
        self.y = np.concatenate([np.asarray(x0, float), np.asarray(v0, float), starts, [1.0, 0.0, 1.0]])
        self.t, self.events, self.log, self._flows, self.recent = 0.0, 0, [], {}, []
        self.modes, self.alternatives = None, 0
        self._settle()

    x = property(lambda self: self.y[: self.n])
    v = property(lambda self: self.y[self.n : 2 * self.n])

    def split(self, modes):
        a, b = len(self.bodies.contacts), len(self.bodies.contacts) + len(self.bodies.friction)
        return modes[:a], modes[a:b], modes[b:]

    def _row(self, x=0.0, v=0.0, one=0.0):
        row = np.zeros(self.size)
        row[: self.n], row[self.n : 2 * self.n], row[-1] = x, v, one
        return row

    def gap(self, c):
        return self._row(x=-c.row, one=c.position)

    def speed(self, element):
        return self._row(v=element.row)

    def sliding(self, f):
        return self._row(v=f.row, one=-f.velocity)

    def spring(self, c):
        return self._row(c.stiffness * c.row, c.damping * c.row, c.preload - c.stiffness * c.position)

    def stretch(self, j):
        slider = self.bodies.sliders[j]
        row = self._row(x=slider.stiffness * slider.row)
        row[2 * self.n + j] = -slider.stiffness
        return row

    def _settle(self):
        """Impacts, then the modes from now on."""
        for _ in range(40):
            if not self._impact():
                break
        else:
            raise Undecided("impacts")
        best = []
        for modes in itertools.product(*self._choices()):
            if not self._agree(modes):
                continue
            flow = self._flow(modes)
            if flow.stands(self.y):
                contacts, friction, sliders = self.split(modes)
                worth = 100 * friction.count("stick") + contacts.count("held") + sliders.count("stick")
                best.append((worth + 0.01 * self._kept(modes), modes))
        if not best:
            raise Undecided("paradox")
        best.sort(key=lambda pair: -pair[0])
        new = best[0][1]
        if self.modes is not None and new != self.modes:
            self.log.append((self.t, self.modes, new))
        self.modes = new
        self.alternatives += len(best) > 1
        self._bring_to_rest()

    def _bring_to_rest(self):
        """Take the rounding errors from the gaps and speeds of what rests."""
        contacts, friction, _ = self.split(self.modes)
        pairs = zip(self.bodies.contacts, contacts, strict=True)
        held = [c for c, mode in pairs if isinstance(c, Rigid) and mode == "held"]
        stuck = [f for f, mode in zip(self.bodies.friction, friction, strict=True) if mode == "stick"]
        gaps = [(c.row, c.position) for c in held]
        speeds = [(c.row, 0.0) for c in held] + [(f.row, f.velocity) for f in stuck]
        for at, wanted in ((0, gaps), (self.n, speeds)):
            if wanted:
                rows, values = np.array([row for row, _ in wanted]), np.array([value for _, value in wanted])
                part = self.y[at : at + self.n]
                part += np.linalg.lstsq(rows, values - rows @ part, rcond=1e-10)[0]

    def _kept(self, modes) -> int:
        """Number of elements within their bounds that keep their mode: what is beyond them lets go."""
        if self.modes is None:
            return 0
        flow = self._flow(self.modes)
        own = {k for k, g in zip(flow.owners, flow.guards @ self.y, strict=True) if g < 1e-9}
        pairs = enumerate(zip(modes, self.modes, strict=True))
        return sum(new == old for k, (new, old) in pairs if k not in own)

    def _flow(self, modes):
        if modes not in self._flows:
            self._flows[modes] = Flow(self, modes)
        return self._flows[modes]

    def _choices(self):
        b, y = self.bodies, self.y
        for c in b.contacts:
            gap, u = self.gap(c) @ y, self.speed(c) @ y
            if isinstance(c, Rigid):
                yield ["held", "open"] if abs(gap) < ZERO and abs(u) < ZERO else ["open"]
            elif abs(gap) < ZERO:
                yield ["closed", "inside", "open"] + (["held"] if abs(u) < ZERO and c.preload > 0 else [])
            else:
                yield ["open"] if gap > 0 else ["closed", "inside"]
        for f in b.friction:
            w = self.sliding(f) @ y
            yield ["stick", "+", "-", "none"] if abs(w) < ZERO else ["+" if w > 0 else "-", "none"]
        for j, slider in enumerate(b.sliders):
            s, v = self.stretch(j) @ y, self.speed(slider) @ y
            at = abs(abs(s) - slider.limit) < ZERO * 10 and s * v >= -ZERO
            yield ["stick", "+" if s > 0 else "-"] if at else ["stick"]

    def _agree(self, modes) -> bool:
        """Friction that nothing presses has no part, all other has one."""
        contacts, friction, _ = self.split(modes)
        return all(
            (mode == "none")
            == (not f.static and not any(contacts[i] in ("held", "closed") for _, _, i in f.tied))
            for f, mode in zip(self.bodies.friction, friction, strict=True)
        )

    def _impact(self) -> bool:
        b, y = self.bodies, self.y
        near = [k for k, c in enumerate(b.contacts) if isinstance(c, Rigid) and abs(self.gap(c) @ y) < ZERO]
        u = {k: self.speed(b.contacts[k]) @ y for k in near}
        near = [k for k in near if u[k] > -ZERO]
        if not any(u[k] > ZERO for k in near):
            return False
        rubbing = [k for k, f in enumerate(b.friction) if any(i in near for _, _, i in f.tied)]
        inverse, found = np.linalg.inv(b.mass), []
        for pushes in itertools.product([True, False], repeat=len(near)):
            on = [k for k, p in zip(near, pushes, strict=True) if p]
            own = [k for k in rubbing if any(i in on for _, _, i in b.friction[k].tied)]
            for acts in itertools.product(["stick", "+", "-"], repeat=len(own)):
                after = self._after(inverse, near, on, dict(zip(own, acts, strict=True)), u)
                if after is not None:
                    found.append(after)
        if not found:
            raise Undecided("impact paradox")
        if max(np.abs(found[0] - other).max() for other in found) > 1e-9:
            raise Undecided("several impacts")
        self.y = y.copy()
        self.y[self.n : 2 * self.n] = found[0]
        self.events += 1
        return True

    def _after(self, inverse, near, on, acts, u):
        """Velocities after an impact, None if a law is broken."""
        b = self.bodies
        stuck = [k for k, act in acts.items() if act == "stick"]
        rows = np.array([b.contacts[k].row for k in on] + [b.friction[k].row for k in stuck]).reshape(
            -1, self.n
        )
        ways = rows.copy()
        for i, k in enumerate(on):
            for j, act in acts.items():
                if act != "stick":
                    mu = sum(mu for mu, _, at in b.friction[j].tied if at == k)
                    ways[i] += (1 if act == "+" else -1) * mu * b.friction[j].row
        r = {k: b.contacts[k].restitution if u[k] > SLOWEST else 0.0 for k in near}
        w = {k: self.sliding(b.friction[k]) @ self.y for k in acts}
        wanted = np.array([(1 + r[k]) * u[k] for k in on] + [w[k] for k in stuck])
        among = rows @ inverse @ ways.T
        if len(rows) and np.linalg.cond(among) > 1e10:
            return None
        p = np.linalg.solve(among, wanted) if len(rows) else wanted
        v = self.v - (inverse @ ways.T @ p if len(rows) else 0)
        push = dict(zip(on, p, strict=False))
        if any(q < -ZERO for q in push.values()):
            return None
        if any(b.contacts[k].row @ v + r[k] * u[k] > ZERO for k in near if k not in on):
            return None
        for k, act in acts.items():
            f = b.friction[k]
            most = sum(mu * push.get(i, 0.0) for mu, _, i in f.tied)
            after = f.row @ v - f.velocity
            if act == "stick" and abs(p[len(on) + stuck.index(k)]) > most + ZERO:
                return None
            if act != "stick" and after * (1 if act == "+" else -1) < -ZERO:
                return None
        return v

    def until(self, t1: float):
        """State at t1."""
        is_new = True
        while self.t < t1:
            flow = self._flow(self.modes)
            step = min(flow.step, t1 - self.t)
            series = flow.series(self.y)
            polynomials = series @ flow.guards.T
            noise = 1e-10 * (np.abs(series) @ np.abs(flow.guards).T) + 1e-13
            if is_new:
                for column in range(polynomials.shape[1]):  # what is zero at an event
                    for k in range(ORDER):
                        if abs(polynomials[k, column]) > noise[k, column]:
                            break
                        polynomials[k, column] = 0.0
            end = self._first_zero(polynomials, step)
            if end is None:
                self.y, self.t, is_new = series.T @ step ** np.arange(ORDER + 1), self.t + step, False
                continue
            self.y, self.t, is_new = series.T @ end ** np.arange(ORDER + 1), self.t + end, True
            self.events += 1
            if self.events > 1500:
                raise Undecided("too many events")
            self._settle()
            self._end_joint_chatter()
        return self.x, self.v

    def _end_joint_chatter(self):
        """Bring contacts to rest that open each other in ever shorter times."""
        self.recent.append(self.t)
        if len(self.recent) < 100 or self.recent[-1] - self.recent[-100] > 1e-8:
            return
        near = [c for c in self.bodies.contacts if isinstance(c, Rigid) and abs(self.gap(c) @ self.y) < 1e-9]
        near = [c for c in near if abs(self.speed(c) @ self.y) < 1e-7]
        rows = np.array([c.row for c in near])
        for at, wanted in ((0, [c.position - c.row @ self.x for c in near]), (self.n, -rows @ self.v)):
            self.y[at : at + self.n] += np.linalg.lstsq(rows, np.array(wanted), rcond=None)[0]
        self.recent = []
        self._settle()

    def _first_zero(self, polynomials, step):
        times = np.concatenate([step * 2.0 ** -np.arange(45, 5, -1.0), np.linspace(0, step, 41)[2:]])
        values = np.vander(times, ORDER + 1, increasing=True) @ polynomials
        broken = (values < 0).any(axis=1)
        if not broken.any():
            return None
        k = int(np.argmax(broken))
        low, high = times[k - 1] if k else 0.0, times[k]
        while high - low > 1e-15 * high:
            middle = (low + high) / 2
            if middle in (low, high):
                break
            is_broken = (middle ** np.arange(ORDER + 1) @ polynomials < 0).any()
            low, high = (low, middle) if is_broken else (middle, high)
        return high
