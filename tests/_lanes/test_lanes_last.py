"""Functions of one trajectory over lanes agree with `jax.vmap`, primitive by primitive."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from vijax._jax.xla import compute_once, in_one_kernel, is_any
from vijax._lanes.transform import arrays_read, lanes_last

# A few operations, in another order.
ROUNDING = 1e-14
LANES = 8


class Numbers(NamedTuple):
    """Arguments of the examples, lanes last."""

    x: jax.Array
    m: jax.Array
    s: jax.Array
    i: jax.Array
    flag: jax.Array


def numbers(lanes: int = LANES) -> Numbers:
    rng = np.random.default_rng(1)
    x, m, s = rng.normal(size=(3, lanes)), rng.normal(size=(3, 3, lanes)), rng.normal(size=lanes)
    i = rng.integers(0, 3, lanes)
    return Numbers(*map(jnp.asarray, (x, m, s, i, s > 0)))


def halved(x, s):
    """Each lane halves its numbers until they are small: lanes end at different turns."""
    return lax.while_loop(
        lambda c: jnp.max(jnp.abs(c[0])) > 0.1, lambda c: (c[0] * 0.5, c[1] + 1), (x + s, 0)
    )


def roots(x):
    step = lambda k, y: y - (y * y - jnp.abs(x)) / (2 * y)  # noqa: E731
    return lax.fori_loop(0, 5, step, jnp.abs(x) + 1)


@jax.custom_jvp
def cube(x):
    return x**3


cube.defjvp(lambda primals, tangents: (cube(*primals), 3 * primals[0] ** 2 * tangents[0]))


@jax.custom_vjp
def doubled(x):
    return 2 * x


doubled.defvjp(lambda x: (2 * x, None), lambda _, g: (2 * g,))

EXAMPLES = {
    "arithmetic": lambda n: (n.x + n.s - 2 * n.x * n.s / (1 + n.x**2), -n.x, abs(n.x), n.x % 2.0, n.x**4),
    "roots and powers": lambda n: (jnp.sqrt(abs(n.x)), abs(n.x) ** 1.5, lax.rsqrt(1 + n.x * n.x)),
    "functions": lambda n: (
        jnp.sin(n.x),
        jnp.exp(n.x),
        jnp.expm1(n.x),
        jnp.log1p(abs(n.x)),
        jnp.arctan2(n.x, n.s),
    ),
    "rounding": lambda n: (jnp.floor(n.x), jnp.ceil(n.x), jnp.round(n.x), jnp.sign(n.x)),
    "comparison": lambda n: (n.x > n.s, n.x == n.x, jnp.isfinite(n.x), ~n.flag & (n.x < 1) | (n.i == 2)),
    "choice": lambda n: (
        jnp.where(n.x > 0, n.x, n.s),
        jnp.clip(n.x, -0.5, 0.5),
        jnp.where(n.flag, True, n.x > 1),
    ),
    "product": lambda n: (n.m @ n.x, n.x @ n.m @ n.x, n.m @ n.m),
    "einsum": lambda n: jnp.einsum("ij,jk,k->i", n.m, n.m, n.x),
    "reduction": lambda n: (
        jnp.sum(n.m, axis=0),
        jnp.max(n.m),
        jnp.min(n.x),
        jnp.prod(n.x),
        jnp.any(n.m > 1, axis=1),
    ),
    "cumulation": lambda n: (jnp.cumsum(n.m, axis=1), jnp.cumprod(n.x), lax.cummax(n.x, reverse=True)),
    "place": lambda n: (jnp.argmax(n.x), jnp.argmin(n.m, axis=0)),
    "gather": lambda n: n.m[jnp.array([2, 0])][:, ::-1],
    "rearrangement": lambda n: (
        n.m.T,
        n.m.reshape(9)[2:7:2],
        jnp.roll(n.x, 1),
        jnp.concatenate([n.x, n.m[0]]),
    ),
    "padding": lambda n: jnp.pad(n.m, 1) @ jnp.ones(5),
    "known numbers": lambda n: n.x * jnp.linspace(0, 1, 3) + jnp.eye(3)[1] + jnp.arange(3.0),
    "index": lambda n: n.x[n.i] + n.m[n.i, 1],
    "update": lambda n: n.x.at[1].set(n.s).at[0].add(2.0).at[2].multiply(n.s),
    "update at an index": lambda n: n.x.at[n.i].set(n.s),
    "repeated update": lambda n: n.x.at[jnp.array([1, 1])].add(n.s),
    "dtypes": lambda n: (
        n.flag + jnp.int8(3),
        n.i.astype(jnp.int32) // 2,
        n.x.astype(jnp.float32) * 2,
        n.i * n.x,
    ),
    "choice of a lane": lambda n: lax.cond(n.s > 0, lambda x: n.m @ x, jnp.sin, n.x),
    "switch of a lane": lambda n: lax.switch(n.i, [lambda: n.x, lambda: 2 * n.x, lambda: -n.x]),
    "scan": lambda n: lax.scan(lambda c, row: (c + row @ n.x, c), n.s, n.m),
    "scan backwards": lambda n: lax.scan(lambda c, row: (c * 0.5 + row, c), n.x, n.m, reverse=True),
    "loop": lambda n: halved(n.x, n.s),
    "nested functions": lambda n: (
        jax.jit(cube)(n.x),
        doubled(n.x),
        jax.checkpoint(jnp.sin)(n.x),
        compute_once(cube, n.x),
    ),
    "jacfwd": lambda n: jax.jacfwd(roots)(n.x),
    "jacobian with a norm": lambda n: jax.jacfwd(lambda x: jnp.sqrt(jnp.sum(x**2)) * jnp.max(x))(n.x),
    "jvp of a custom rule": lambda n: jax.jvp(cube, (n.x,), (n.m[0],)),
    "grad": lambda n: jax.grad(lambda x: jnp.sum(jnp.sin(n.m @ x)))(n.x),
    "hessian": lambda n: jax.hessian(lambda x: jnp.exp(0.1 * x @ n.m @ x))(n.x),
}


def difference(a, b) -> float:
    """Largest difference of two trees, whose shapes and types must agree."""
    rows = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    sizes = [0.0]
    for p, q in rows:
        assert (p.shape, p.dtype) == (q.shape, q.dtype)
        sizes.append(float(np.max(np.abs(np.asarray(p, float) - np.asarray(q, float)), initial=0)))
    return max(sizes)


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_function_over_lanes_is_that_of_every_lane(name):
    function, given = EXAMPLES[name], numbers()
    found = jax.jit(lanes_last(function))(given)
    assert difference(found, jax.jit(jax.vmap(function, -1, -1))(given)) <= ROUNDING * 10


KERNELS = ["arithmetic", "choice", "product", "update", "choice of a lane", "loop", "jacfwd", "scan"]


@pytest.mark.parametrize("name", KERNELS)
def test_it_runs_inside_one_kernel(name):
    function, given = lanes_last(EXAMPLES[name]), numbers()
    # A kernel must read, or hand back, all arguments.
    found, _ = jax.jit(lambda n: in_one_kernel(lambda n: (function(n), n), n))(given)
    assert difference(found, jax.jit(function)(given)) <= ROUNDING


def test_an_unknown_primitive_is_named():
    with pytest.raises(NotImplementedError, match="`sort`"):
        lanes_last(jnp.sort)(numbers().x)


def test_an_unknown_place_to_read_is_refused():
    with pytest.raises(NotImplementedError, match="`gather` with unknown indices"):
        lanes_last(lambda x, i: x[jnp.stack([i, i])])(numbers().x, numbers().i)


def test_numbers_of_lanes_must_agree():
    with pytest.raises(ValueError, match="last axes"):
        lanes_last(jnp.add)(jnp.ones(3), jnp.ones(4))


class Part(eqx.Module):
    stiffness: jax.Array
    name: str
    missing: None = None


def test_static_leaves_and_missing_ones_pass():
    part = Part(jnp.ones((2, LANES)), "spring")
    found = lanes_last(lambda p, x: eqx.tree_at(lambda p: p.stiffness, p, p.stiffness * x))(part, numbers().s)
    assert (found.name, found.missing) == ("spring", None)
    assert difference(found.stiffness, jnp.broadcast_to(numbers().s, (2, LANES))) == 0


def steady(shared, x):
    """Something that depends on shared numbers alone, and something else."""
    return jnp.sin(shared) * x + jnp.exp(shared) * x**2, shared


@pytest.mark.parametrize("shape", [(2, 1), (2, LANES)])
def test_shared_numbers_are_those_of_every_lane(shape):
    shared, x = jnp.asarray([[0.3], [0.7]]), numbers().x[:2]
    found = jax.jit(lanes_last(steady))(jnp.broadcast_to(shared, shape), x)
    assert (
        difference(
            found, (jnp.sin(shared) * x + jnp.exp(shared) * x**2, jnp.broadcast_to(shared, (2, LANES)))
        )
        <= ROUNDING
    )


def operations(text: str, name: str) -> list[str]:
    """Types of the results of an operation in a lowered program."""
    return [
        line.split("->")[-1].split(":")[-1].strip()
        for line in text.splitlines()
        if f"stablehlo.{name} " in line
    ]


def test_shared_numbers_are_computed_once():
    text = jax.jit(lanes_last(steady)).lower(jnp.ones((2, 1)), numbers().x[:2]).as_text()
    assert set(operations(text, "sine")) == {"tensor<f64>"}


def test_known_zeros_and_ones_cost_nothing():
    function = lanes_last(lambda x: jnp.eye(3) @ x + jnp.zeros(3) * jnp.sin(x))
    text = jax.jit(function).lower(numbers().x).as_text()
    assert operations(text, "multiply") + operations(text, "sine") + operations(text, "add") == []


def test_a_division_stays_one():
    text = jax.jit(lanes_last(lambda x: (x / 3, x / 4))).lower(numbers().s).as_text()
    assert len(operations(text, "divide")) == 1


def test_equal_operations_are_one():
    text = jax.jit(lanes_last(lambda x: (jnp.sin(x) + 1, 2 * jnp.sin(x)))).lower(numbers().s).as_text()
    assert len(operations(text, "sine")) == 1


def mixed(n: Numbers):
    """Straight code, a derivative and a loop, in one."""
    y, turns = halved(n.x, n.s)
    return jnp.linalg.norm(n.m @ n.x) * y, turns, jax.jacfwd(lambda x: x / (1 + x @ x))(n.x)


def test_a_lane_has_the_same_bits_among_any_others():
    given, function = numbers(64), jax.jit(lanes_last(mixed))
    others = jax.tree.map(lambda a: jnp.where(jnp.arange(64) == 5, a, a[..., ::-1]), given)
    for again, place in (
        (others, 5),
        (jax.tree.map(lambda a: a[..., 3:10], given), 2),
        (jax.tree.map(lambda a: a[..., 5:6], given), 0),
    ):
        one = jax.tree.map(lambda a: a[..., 5], function(given))
        assert difference(one, jax.tree.map(lambda a, k=place: a[..., k], function(again))) == 0


@pytest.mark.parametrize("is_flat", [False, True])
def test_a_choice_for_all_lanes_computes_one_case(is_flat):
    rare = lambda x: jnp.sin(x) + jnp.sum(x)  # noqa: E731
    function = lanes_last(lambda x: lax.cond(is_any(x[0] > 10), rare, lambda x: 2 * x, x))
    x = jnp.where(is_flat, numbers().x, numbers().x + 11)
    expected = 2 * x if is_flat else jax.vmap(rare, -1, -1)(x)
    assert difference(jax.jit(function)(x), expected) <= 10 * ROUNDING
    text = jax.jit(function).lower(x).as_text()
    assert "stablehlo.case" in text
    assert operations(text, "sine") != []


def test_choices_nest():
    inner = lambda x: lax.cond(is_any(x > 1), lambda: x * 3, lambda: x)  # noqa: E731
    function = lanes_last(lambda x: lax.cond(is_any(x > 0), lambda: inner(x) + jnp.cos(x), lambda: x))
    x = numbers().s
    assert difference(jax.jit(function)(x), x * (3 if jnp.any(x > 1) else 1) + jnp.cos(x)) <= ROUNDING


def test_a_loop_with_one_condition_for_all_lanes_stays_one():
    def function(x, count):
        body = lambda c: (jnp.tanh(c[0]) + lax.cond(is_any(c[0] > 0), lambda: c[0], lambda: -c[0]), c[1] - 1)  # noqa: E731
        return lax.while_loop(lambda c: c[1] > 0, body, (x, count))[0]

    x = numbers().s
    found, expected = jax.jit(lanes_last(function))(x, jnp.asarray([4])), x
    for _ in range(4):
        expected = jnp.tanh(expected) + (expected if jnp.any(expected > 0) else -expected)
    assert difference(found, expected) <= 10 * ROUNDING


def test_arrays_that_matter_are_told():
    def function(x, y, z, live):
        a, _ = lax.while_loop(lambda c: c[1] < 3, lambda c: (c[0] + y, c[1] + 1), (x[0] * 0, 0))
        return a + 0 * z, jnp.where(live, 1.0, 1.0)

    shapes = [jax.ShapeDtypeStruct(shape, float) for shape in ((2,), (), ())]
    assert arrays_read(function, *shapes, jax.ShapeDtypeStruct((), bool))[1:3] == [True, False]
