"""Control flow: choices that are the same for all lanes, and loops, stay; the rest becomes selections.

A lane that is done with a loop keeps its values by selections while others go on.
"""

from collections.abc import Callable, Collection, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .elements import as_elements, flat, regrouped, rows_of
from .graph import Block, Element, Node, is_known, is_shared, leaf_like, ordered
from .rules import RULES, Program


class Inside:
    """Elements inside of a block that stand for those outside.

    Attributes:
        outside: the node that each leaf stands for.
    """

    def __init__(self):
        self.outside: dict[Node, Node] = {}
        self._leaves: dict[Node, Node] = {}

    def of(self, arrays: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Arrays of leaves for arrays of elements; known numbers stay known."""
        return regrouped([self._leaf(element) for element in flat(arrays)], arrays)

    def _leaf(self, element: Element) -> Element:
        if is_known(element):
            return element
        if element not in self._leaves:
            self._leaves[element] = leaf_like(element)
            self.outside[self._leaves[element]] = element
        return self._leaves[element]

    def needed(self, elements: Sequence[Element]) -> dict[Node, Node]:
        """Leaves that elements inside need, and what they stand for."""
        done, waiting, found = set(), [e for e in elements if not is_known(e)], {}
        while waiting:
            node = waiting.pop()
            if node in done:
                continue
            done.add(node)
            if node in self.outside:
                found[node] = self.outside[node]
            elif node.block is not None:
                block, place = node.block
                waiting.extend(block.inputs({place}))
            else:
                waiting.extend(a for a in node.args if not is_known(a))
        return found


def results(block: Block, shapes: Sequence[np.ndarray], like: Sequence[tuple[Any, bool]]) -> list[np.ndarray]:
    """Results of a block: nodes with these types, shared or not."""
    nodes = [Node(None, (), {}, dtype, shared, (block, k)) for k, (dtype, shared) in enumerate(like)]
    return regrouped(nodes, shapes)


class Choice(Block):
    """Choice that is the same for all lanes: only what is chosen is computed."""

    def __init__(
        self, index: Node, inside: Inside, cases: Sequence[Sequence[Element]], dtypes: Sequence[Any]
    ):
        self.index, self.inside, self.cases, self.dtypes = index, inside, cases, dtypes

    def inputs(self, used: Collection[int]) -> list[Node]:
        """The index, and what the cases need."""
        needed = self.inside.needed([case[k] for case in self.cases for k in used])
        return list(dict.fromkeys([self.index, *needed.values()]))

    def emit(self, read: Callable[[Element], Any], used: list[int], emit: Callable[..., list]) -> list:
        """`jax.lax.switch` over the cases."""
        needed = self.inside.needed([case[k] for case in self.cases for k in used])
        values = {leaf: read(node) for leaf, node in needed.items()}
        shared = [all(is_shared(case[k]) for case in self.cases) for k in used]

        def branch(case: Sequence[Element]) -> Callable[[], list]:
            return lambda: emit([case[k] for k in used], values, shared)

        index = jnp.clip(jnp.asarray(read(self.index), jnp.int32), 0, len(self.cases) - 1)
        if len(self.cases) == 2:
            return jax.lax.cond(read(self.index) > 0, branch(self.cases[1]), branch(self.cases[0]))
        return jax.lax.switch(index, [branch(case) for case in self.cases])


def choose(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    """`cond` and `switch`: a choice if the index is shared, else selections among all cases."""
    index: Any = xs[0][()]
    branches = equation.params["branches"]
    if is_known(index):
        return program.run(branches[min(max(int(index), 0), len(branches) - 1)], xs[1:])
    avals = [v.aval for v in equation.outvars]
    if not index.is_shared:
        cases = [program.run(branch, xs[1:]) for branch in branches]
        pick = program.arithmetic.choose
        return [pick(index, case, a.dtype) for case, a in zip(zip(*cases, strict=True), avals, strict=True)]
    inside = Inside()
    args = inside.of(xs[1:])
    # A graph each: what one case computes the other must not rely on.
    arrays = [Program().run(branch, args) for branch in branches]
    cases = [flat(case) for case in arrays]
    dtypes = [a.dtype for a, x in zip(avals, arrays[0], strict=True) for _ in range(x.size)]
    block = Choice(index, inside, cases, dtypes)
    like = [
        (dtype, index.is_shared and all(is_shared(case[k]) for case in cases))
        for k, dtype in enumerate(dtypes)
    ]
    found = flat(results(block, arrays[0], like))
    for k, elements in enumerate(zip(*cases, strict=True)):
        if all(e is elements[0] or _equal(e, elements[0]) for e in elements) and (
            is_known(elements[0]) or elements[0] in inside.outside
        ):
            found[k] = inside.outside.get(elements[0], elements[0])
    return regrouped(found, arrays[0])


def _equal(a: Element, b: Element) -> bool:
    return is_known(a) and is_known(b) and a.tobytes() == b.tobytes()


class Loop(Block):
    """Loop: its first values, and one turn from leaves to the next values.

    Attributes:
        first: flag that the loop goes on, then the elements that it carries, outside.
        leaves: the same inside, at the start of a turn.
        last: the same at the end of it.
        inside: what else it reads.
    """

    def __init__(self, first: list[Element], leaves: list[Node], last: list[Element], inside: Inside):
        self.first, self.leaves, self.last, self.inside = first, leaves, last, inside

    def inputs(self, used: Collection[int]) -> list[Node]:
        """All that it begins with or reads."""
        needed = self.inside.needed(self.last)
        return list(dict.fromkeys([*(e for e in self.first if not is_known(e)), *needed.values()]))

    def emit(self, read: Callable[[Element], Any], used: list[int], emit: Callable[..., list]) -> list:
        """`jax.lax.while_loop` while any lane goes on."""
        needed = {leaf: read(node) for leaf, node in self.inside.needed(self.last).items()}
        shared = [leaf.is_shared for leaf in self.leaves]

        steady = self._steady()
        found = emit(steady, needed, [node.is_shared for node in steady])
        known = {**needed, **dict(zip(steady, found, strict=True))}

        def turn(carry: list) -> list:
            return emit(self.last, {**known, **dict(zip(self.leaves, carry, strict=True))}, shared)

        first = emit(self.first, {e: read(e) for e in self.first if not is_known(e)}, shared)
        last = jax.lax.while_loop(lambda carry: jnp.any(carry[0]), turn, first)
        return [last[1 + k] for k in used]

    def _steady(self) -> list[Node]:
        """Nodes that are the same in every turn, and that others need: computed before the loop."""
        changes = dict.fromkeys(self.leaves, True)
        found: dict[Node, None] = {}
        for node in ordered((e for e in self.last if not is_known(e)), needs_of):
            operands = needs_of(node)
            changes.setdefault(node, any(changes[a] for a in operands) or node.block is not None)
            if changes[node]:
                found.update(dict.fromkeys(a for a in operands if not changes[a] and a.primitive is not None))
        last = (e for e in self.last if not is_known(e) and not changes[e] and e.primitive is not None)
        return list(found | dict.fromkeys(last))


def needs_of(node: Node) -> list[Node]:
    """Nodes that a node is computed from."""
    if node.block is None:
        return [a for a in node.args if not is_known(a)]
    block, place = node.block
    return block.inputs({place})


def loop(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    """`while`: a loop for all lanes, whose condition may differ between them."""
    p = equation.params
    in_condition, in_body = p["cond_nconsts"], p["body_nconsts"]
    carry = xs[in_condition + in_body :]
    (begins,) = program.run(p["cond_jaxpr"], [*xs[:in_condition], *carry])
    goes_on = begins[()]
    if is_known(goes_on) and not goes_on:
        return carry
    dtypes = [v.aval.dtype for v, x in zip(equation.outvars, carry, strict=True) for _ in range(x.size)]
    first = [goes_on, *flat(carry)]
    shared = [is_shared(element) for element in first]
    while True:
        turn = _turn(p, xs, carry, dtypes, shared)
        after = [was and (is_shared(e)) for was, e in zip(shared, turn[1], strict=True)]
        if after == shared:
            break
        shared = after
    leaves, last, inside = turn
    block = Loop(first, leaves, last, inside)
    return results(block, carry, list(zip(dtypes, shared[1:], strict=True)))


def _turn(
    p: dict[str, Any], xs: list[np.ndarray], carry: list[np.ndarray], dtypes: list[Any], shared: list[bool]
) -> tuple[list[Node], list[Element], Inside]:
    """Leaves at the start of a turn, elements at its end, and what else it reads."""
    in_condition, in_body = p["cond_nconsts"], p["body_nconsts"]
    inside, program = Inside(), Program()
    consts = inside.of(xs[: in_condition + in_body])
    live = Node(None, (), {}, bool, shared[0])
    old = [Node(None, (), {}, t, s) for t, s in zip(dtypes, shared[1:], strict=True)]
    arrays = program.run(p["body_jaxpr"], [*consts[in_condition:], *regrouped(old, carry)])
    new = flat(arrays)
    if not live.is_shared:
        graph = program.graph
        new = [
            o if n is o else graph.make("select_n", (live, o, n), t)
            for o, n, t in zip(old, new, dtypes, strict=True)
        ]
    (still,) = program.run(p["cond_jaxpr"], [*consts[:in_condition], *regrouped(new, carry)])
    goes_on = still[()]
    if not live.is_shared:
        goes_on = program.graph.make("and", (live, goes_on), bool)
    return [live, *old], [goes_on, *new], inside


def scan(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    """`scan`, written out."""
    p = equation.params
    in_consts, in_carry = _parts_of_scan(p)
    consts, carry, rows = xs[:in_consts], xs[in_consts : in_consts + in_carry], xs[in_consts + in_carry :]
    found, given = [], [rows_of(row) for row in rows]
    steps = range(p["length"])
    for k in reversed(steps) if p["reverse"] else steps:
        out = program.run(p["jaxpr"], [*consts, *carry, *(row[k] for row in given)])
        carry = out[:in_carry]
        found.append(out[in_carry:])
    found = found[::-1] if p["reverse"] else found
    if not found:
        avals = [v.aval for v in equation.outvars[in_carry:]]
        return [*carry, *(as_elements(np.zeros(a.shape, a.dtype)) for a in avals)]
    return [*carry, *(np.stack(column) for column in zip(*found, strict=True))]


def _parts_of_scan(params: dict[str, Any]) -> tuple[int, int]:
    """Number of constants and of carried arrays among the operands."""
    if "num_consts" in params:
        return params["num_consts"], params["num_carry"]
    consts, carry, _ = params["ft_in"].unpack()  # since JAX 0.11
    return len(consts), len(carry)


RULES.update({"cond": choose, "while": loop, "scan": scan})
