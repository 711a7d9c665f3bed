"""Rules of the primitives: a program of JAX, evaluated with every element a node of a graph.

To add a primitive, add its name to `_ELEMENTWISE`, or a rule to `_RULES`: a function of the program, the equation and
its operands that returns its results.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from .elements import Arithmetic, as_elements, flat, moved, rows_of, shaped
from .folding import EXACT
from .graph import Graph, is_known

_ELEMENTWISE = {
    *EXACT,
    *"exp exp2 log log1p expm1 sin cos tan tanh asin acos atan atan2 sinh cosh asinh acosh atanh logistic pow rem rsqrt cbrt erf".split(),
    *"integer_pow select_n round convert_element_type is_finite clamp bitcast_convert_type nextafter copy".split(),
    *"shift_left shift_right_logical shift_right_arithmetic erf_inv erfc square reduce_precision".split(),
}


class Program:
    """Evaluation of programs into one graph."""

    def __init__(self):
        self.graph = Graph()
        self.arithmetic = Arithmetic(self.graph)

    def run(self, jaxpr: Any, args: Sequence[np.ndarray], consts: Sequence[Any] = ()) -> list[np.ndarray]:
        """Results of a program, from its arguments and constants; those of a closed one are its own."""
        if hasattr(jaxpr, "jaxpr"):
            jaxpr, consts = jaxpr.jaxpr, [as_elements(c) for c in jaxpr.consts]
        values = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *args], strict=True))

        def read(variable: Any) -> np.ndarray:
            if isinstance(variable, Literal):
                return as_elements(np.asarray(variable.val, getattr(variable.aval, "dtype", None)))
            return values[variable]

        for equation in jaxpr.eqns:
            found = self._apply(equation, [read(v) for v in equation.invars])
            values.update(zip(equation.outvars, found, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def _apply(self, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        name = equation.primitive.name
        if name in _ELEMENTWISE:
            dtype = equation.outvars[0].aval.dtype
            return [self.arithmetic.each(name, xs, dtype, equation.params, equation.primitive)]
        if name not in RULES:
            raise NotImplementedError(f"`lanes_last` has no rule for the primitive `{name}`.")
        return RULES[name](self, equation, xs)


Rule = Callable[[Program, Any, list[np.ndarray]], list[np.ndarray]]


def call(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    """A function called: its program. The compiler's directives of the call are ignored; fences are placed anew."""
    for name in ("jaxpr", "call_jaxpr", "fun_jaxpr"):
        if name in equation.params:
            return program.run(equation.params[name], xs)
    raise NotImplementedError(f"`lanes_last` finds no program in the primitive `{equation.primitive.name}`.")


def _broadcast(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    shape, axes = equation.params["shape"], equation.params["broadcast_dimensions"]
    own = [1] * len(shape)
    for axis, size in zip(axes, xs[0].shape, strict=True):
        own[axis] = size
    return [np.broadcast_to(xs[0].reshape(own), shape)]


def _reshape(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    return [xs[0].reshape(equation.outvars[0].aval.shape)]


def _slice(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    p = equation.params
    steps = p["strides"] or [1] * xs[0].ndim
    return [xs[0][tuple(map(slice, p["start_indices"], p["limit_indices"], steps))]]


def _split(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    return np.split(xs[0], np.cumsum(equation.params["sizes"])[:-1], axis=equation.params["axis"])


def _iota(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    p = equation.params
    line = np.arange(int(p["shape"][p["dimension"]])).astype(p["dtype"])
    own = [len(line) if axis == p["dimension"] else 1 for axis in range(len(p["shape"]))]
    return [as_elements(np.broadcast_to(line.reshape(own), p["shape"]))]


def _dot(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    dtype = equation.outvars[0].aval.dtype
    return [program.arithmetic.dot(xs[0], xs[1], equation.params["dimension_numbers"], dtype)]


def _reduction(name: str, empty: Callable[[Any], Any]) -> Rule:
    def rule(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        dtype = equation.outvars[0].aval.dtype
        return [
            program.arithmetic.fold(
                name, xs[0], tuple(map(int, equation.params["axes"])), dtype, empty(dtype)
            )
        ]

    return rule


def _accumulation(name: str) -> Rule:
    def rule(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        p, dtype = equation.params, equation.outvars[0].aval.dtype
        return [program.arithmetic.accumulate(name, xs[0], p["axis"], dtype, reverse=p["reverse"])]

    return rule


def _place_of(largest: bool) -> Rule:
    def rule(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        axis, dtype = int(equation.params["axes"][0]), equation.outvars[0].aval.dtype
        return [program.arithmetic.extreme(xs[0], axis, dtype, largest=largest)]

    return rule


def _rearranged(indices: Callable[[int], bool]) -> Rule:
    def rule(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        dtype = equation.outvars[0].aval.dtype
        if not all(map(is_known, flat([x for k, x in enumerate(xs) if indices(k)]))):
            return [_put_at_unknown(program, equation, xs)]
        return [moved(equation.primitive, equation.params, xs, lambda k: not indices(k), dtype)]

    return rule


def _put_at_unknown(program: Program, equation: Any, xs: list[np.ndarray]) -> np.ndarray:
    """`x.at[i].set(new)` with one place that is not known: every place is tried. Places beyond the end are none."""
    name, dtype = equation.primitive.name, equation.outvars[0].aval.dtype
    numbers = equation.params["dimension_numbers"]
    axes = numbers.scatter_dims_to_operand_dims if name == "scatter" else ()
    x, at, _ = xs if len(xs) == 3 else (*xs, None)
    if not axes or at.size != len(axes):
        raise NotImplementedError(
            f"`lanes_last` has no rule for the primitive `{name}` with unknown indices."
        )
    make, out = program.graph.make, x
    for place in product(*(range(x.shape[axis]) for axis in axes)):
        hit: Any = np.bool_(True)
        for index, k in zip(at.flat, place, strict=True):
            hit = make("and", (hit, make("eq", (index, index.dtype.type(k)), bool)), bool)
        known = as_elements(np.asarray(place, at.flat[0].dtype).reshape(at.shape))
        case = moved(equation.primitive, equation.params, [x, known, xs[2]], lambda k: k != 1, dtype)
        out = program.arithmetic.each("select_n", (shaped([hit], ()), out, case), dtype)
    return out


def _scatter_combined(name: str, neutral: int) -> Rule:
    def rule(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
        x, at, new = xs
        if not all(map(is_known, at.flat)):
            whom = equation.primitive.name
            raise NotImplementedError(
                f"`lanes_last` has no rule for the primitive `{whom}` with unknown indices."
            )
        dtype, out = equation.outvars[0].aval.dtype, x
        places = np.asarray(at.tolist(), equation.invars[1].aval.dtype).reshape(at.shape)
        # One update at a time: several may share a place.
        for k in range(new.size):
            marks = np.where(np.arange(new.size) == k, 2, neutral).astype(dtype).reshape(new.shape)
            with jax.ensure_compile_time_eval():
                given = map(jnp.asarray, (np.full(x.shape, neutral, dtype), places, marks))
                is_hit = np.asarray(equation.primitive.bind(*given, **equation.params)) != neutral
            if np.any(is_hit):
                both = program.arithmetic.each(name, (out, shaped([new.flat[k]], ())), dtype)
                out = np.where(is_hit, both, out)
        return [out]

    return rule


def _dynamic_slice(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    x, starts = xs[0], [i[()] for i in xs[1:]]
    for axis, (start, size) in enumerate(zip(starts, equation.params["slice_sizes"], strict=True)):
        last = x.shape[axis] - size
        cases = [x[(slice(None),) * axis + (slice(k, k + size),)] for k in range(last + 1)]
        if is_known(start):
            x = cases[min(max(int(start), 0), last)]
        else:
            x = program.arithmetic.choose(start, cases, equation.outvars[0].aval.dtype)
    return [x]


def _dynamic_update(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    x, new, starts = xs[0], xs[1], [i[()] for i in xs[2:]]
    dtype = equation.outvars[0].aval.dtype

    def put(at: tuple[int, ...]) -> np.ndarray:
        out = x.copy()
        out[tuple(slice(k, k + n) for k, n in zip(at, new.shape, strict=True))] = new
        return out

    def place(at: tuple[int, ...]) -> np.ndarray:
        axis = len(at)
        if axis == x.ndim:
            return put(at)
        last, start = x.shape[axis] - new.shape[axis], starts[axis]
        if is_known(start):
            return place((*at, min(max(int(start), 0), last)))
        return program.arithmetic.choose(start, [place((*at, k)) for k in range(last + 1)], dtype)

    return [place(())]


def _any_lane(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    """`is_any`: true where the flag is set in any element of any lane."""
    x = xs[0]
    flag = program.arithmetic.fold("or", x, range(x.ndim), bool, False)[()]
    out = np.empty((), object)
    out[()] = program.graph.any_lane(flag)
    return [out]


def _same(program: Program, equation: Any, xs: list[np.ndarray]) -> list[np.ndarray]:
    return xs


def _lowest(dtype: np.dtype) -> Any:
    return -np.inf if dtype.kind == "f" else (False if dtype.kind == "b" else np.iinfo(dtype).min)


def _highest(dtype: np.dtype) -> Any:
    return np.inf if dtype.kind == "f" else (True if dtype.kind == "b" else np.iinfo(dtype).max)


RULES: dict[str, Rule] = {
    **dict.fromkeys(
        "pjit jit closed_call core_call remat checkpoint remat2 custom_jvp_call custom_vjp_call".split(),
        call,
    ),
    "broadcast_in_dim": _broadcast,
    **dict.fromkeys(("reshape", "squeeze", "expand_dims"), _reshape),
    "transpose": lambda program, e, xs: [np.transpose(xs[0], e.params["permutation"])],
    "slice": _slice,
    "rev": lambda program, e, xs: [np.flip(xs[0], e.params["dimensions"])],
    "concatenate": lambda program, e, xs: [np.concatenate(xs, axis=e.params["dimension"])],
    "stack": lambda program, e, xs: [np.stack(xs, axis=e.params["axis"])],
    "unstack": lambda program, e, xs: rows_of(xs[0], e.params["axis"]),
    "split": _split,
    "iota": _iota,
    **dict.fromkeys(("stop_gradient", "optimization_barrier", "copy_p"), _same),
    "add_any": lambda program, e, xs: [program.arithmetic.each("add", xs, e.outvars[0].aval.dtype)],
    "dot_general": _dot,
    "reduce_sum": _reduction("add", lambda dtype: 0),
    "reduce_prod": _reduction("mul", lambda dtype: 1),
    "reduce_max": _reduction("max", _lowest),
    "reduce_min": _reduction("min", _highest),
    "reduce_and": _reduction("and", lambda dtype: True),
    "reduce_or": _reduction("or", lambda dtype: False),
    "cumsum": _accumulation("add"),
    "cumprod": _accumulation("mul"),
    "cummax": _accumulation("max"),
    "cummin": _accumulation("min"),
    "argmax": _place_of(largest=True),
    "argmin": _place_of(largest=False),
    "gather": _rearranged(lambda k: k == 1),
    "scatter": _rearranged(lambda k: k == 1),
    "pad": _rearranged(lambda k: False),
    "scatter-add": _scatter_combined("add", 0),
    "scatter_add": _scatter_combined("add", 0),
    "scatter_mul": _scatter_combined("mul", 1),
    "scatter-mul": _scatter_combined("mul", 1),
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update,
    "unvmap_any": _any_lane,
}
