"""From elements back to arrays, with fences.

XLA copies a value with several users into each of them. A value that several others need, and that costs `_CHEAP`
operations or more, is a root, computed once. Roots of one depth, none of which needs another, go together into one
call that XLA may not inline (`compute_once`).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax.numpy as jnp

from .._jax.xla import compute_once
from .graph import AnyLane, Block, Element, Node, is_known, ordered

# Operations from which on a value with several users is a root, and beyond which any value is.
_CHEAP, _MANY = 3, 200
# Costs beside that of an addition.
_COST = {
    **dict.fromkeys(("div", "any_lane"), 6),
    **dict.fromkeys(("sqrt", "rsqrt"), 8),
    **dict.fromkeys("exp exp2 log log1p expm1 rem".split(), 30),
    **dict.fromkeys(
        "sin cos tan tanh asin acos atan atan2 sinh cosh asinh acosh atanh logistic pow cbrt erf erf_inv".split(),
        60,
    ),
}
Vertex = Node | Block


def emit(
    outs: Sequence[Element], values: dict[Node, Any], lanes: int, shared: Sequence[bool], *, fences: bool
) -> list:
    """Values of elements: numbers where they are `shared`, else arrays over the lanes.

    Args:
        outs: the elements.
        values: of the leaves.
        lanes: number of lanes.
        shared: for each element, if a single number is asked for.
        fences: whether there are any.
    """
    plan, values = _Plan(outs, values), dict(values)

    def inner(outs: Sequence[Element], values: dict[Node, Any], shared: Sequence[bool]) -> list:
        return emit(outs, values, lanes, shared, fences=fences)

    for level in plan.levels:
        for block in (v for v in level if isinstance(v, Block)):
            places = sorted(plan.used[block])
            found = block.emit(lambda e: e if is_known(e) else values[e], places, inner)
            values.update(zip((plan.results[block, k] for k in places), found, strict=True))
        roots = [v for v in level if isinstance(v, Node)]
        if roots:
            needs = _ends(roots, values)
            call = _computation(roots, needs)
            given = [values[n] for n in needs]
            # Without an argument lanes share, XLA computes it when it compiles.
            found = compute_once(call, *given) if fences and given else call(*given)
            values.update(zip(roots, found, strict=True))
    found = [jnp.asarray(e, e.dtype) if is_known(e) else values[e] for e in outs]
    return [v if one else jnp.broadcast_to(v, (lanes,)) for v, one in zip(found, shared, strict=True)]


def _computation(roots: list[Node], needs: list[Node]) -> Callable[..., list]:
    def compute(*given: Any) -> list:
        values = dict(zip(needs, given, strict=True))
        for node in ordered(roots, lambda n: [] if n in values else [a for a in n.args if not is_known(a)]):
            if node not in values:
                values[node] = _apply(node, [a if is_known(a) else values[a] for a in node.args])
        return [values[root] for root in roots]

    return compute


def _apply(node: Node, args: list) -> Any:
    if node.primitive is AnyLane:
        return AnyLane.bind(*args)
    shape = max((jnp.shape(a) for a in args), key=len)
    args = [jnp.broadcast_to(jnp.asarray(a, a.dtype), shape) for a in args]
    return node.primitive.bind(*args, **node.params)


def _ends(roots: list[Node], values: dict[Node, Any]) -> list[Node]:
    """Nodes with values that roots are computed from."""
    inner = lambda n: [] if n in values else [a for a in n.args if not is_known(a)]  # noqa: E731
    return [n for n in ordered(roots, inner) if n in values]


class _Plan:
    """Order in which roots and blocks are computed.

    Attributes:
        used: places of the results of each block that are needed.
        results: the nodes of these results.
        levels: roots and blocks of each depth.
    """

    def __init__(self, outs: Sequence[Element], values: dict[Node, Any]):
        self._values = values
        self.used: dict[Block, set[int]] = {}
        self.results: dict[tuple[Block, int], Node] = {}
        given = dict.fromkeys(e for e in outs if not is_known(e))
        self._find_used(given)
        order = ordered(given, self._needs)
        users: dict[Vertex, list[Vertex]] = {v: [] for v in order}
        for vertex in order:
            for need in dict.fromkeys(self._needs(vertex)):
                users[need].append(vertex)
        roots = self._roots(order, users, given)
        self.levels = self._levels(order, roots)

    def _needs(self, vertex: Vertex) -> list:
        if isinstance(vertex, Block):
            return vertex.inputs(self.used[vertex])
        if vertex in self._values:
            return []
        if vertex.block is not None:
            return [vertex.block[0]]
        return [a for a in vertex.args if not is_known(a)]

    def _find_used(self, outs: Iterable[Node]) -> None:
        waiting, done = list(outs), set()
        while waiting:
            node = waiting.pop()
            if node in done or node in self._values:
                continue
            done.add(node)
            if node.block is None:
                waiting.extend(a for a in node.args if not is_known(a))
                continue
            block, place = node.block
            self.used.setdefault(block, set()).add(place)
            self.results[block, place] = node
            waiting.extend(block.inputs({place}))

    def _is_computed(self, vertex: Vertex) -> bool:
        return isinstance(vertex, Node) and vertex.block is None and vertex not in self._values

    def _heavy(self, order: list, users: dict) -> tuple[dict, set]:
        """Cost of each value from the heavy ones before it, and the values worth a root."""
        cost, heavy = {}, set()
        for v in order:
            cost[v] = 0
            if not self._is_computed(v):
                continue
            own = _COST.get(v.primitive.name, 1)
            cost[v] = own + sum(cost[a] for a in self._needs(v) if a not in heavy)
            # Once for all lanes, not once for each.
            is_last_shared = v.is_shared and any(not getattr(u, "is_shared", True) for u in users[v])
            if (len(users[v]) > 1 and cost[v] >= _CHEAP) or cost[v] > _MANY or is_last_shared:
                heavy.add(v)
        return cost, heavy

    def _roots(self, order: list, users: dict, outs: dict) -> set:
        """Values that are computed once: results, inputs of blocks, and heavy ones with several cones of users."""
        cost, heavy = self._heavy(order, users)
        cones: dict[Any, set] = {}
        roots = set()
        for v in reversed(order):
            into: set = {None} if v in outs else set()
            for u in users[v]:
                into |= {u} if u in roots or not self._is_computed(u) else cones[u]
            cones[v] = into
            if not self._is_computed(v):
                continue
            is_input = any(isinstance(u, Block) for u in users[v])
            is_last_shared = v.is_shared and any(not getattr(u, "is_shared", True) for u in users[v])
            is_worth_it = v in heavy and (len(into) > 1 or cost[v] > _MANY or is_last_shared)
            if v in outs or is_input or is_worth_it:
                roots.add(v)
        return roots

    def _levels(self, order: list, roots: set) -> list[list[Vertex]]:
        depth: dict[Any, int] = {}
        levels: dict[int, list[Vertex]] = {}
        for v in order:
            depth[v] = max((depth[a] for a in self._needs(v)), default=0)
            if v in roots or isinstance(v, Block):
                depth[v] += 1
                levels.setdefault(depth[v], []).append(v)
        return [levels[d] for d in sorted(levels)]
