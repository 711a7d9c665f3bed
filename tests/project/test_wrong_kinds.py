"""Every argument of every public function is named in the sentence that refuses what it cannot be."""

import inspect
import pickle

import jax
import jax.numpy as jnp
import jaxtyping
import matplotlib as mpl
import numpy as np
import pytest
from scipy.stats import norm

import vijax as vx
from vijax._calls import with_explained_errors

mpl.use("Agg")


@pytest.fixture(autouse=True)
def _unchecked():
    """Annotations are not checked, as for users: the next test sets its own choice."""
    jaxtyping.config.update("jaxtyping_disable", True)


ONE = vx.models.impact_oscillator(0.8, 1.0, position=1.0, restitution=0.8, damping_ratio=0.05)
VALUES = {"forcing.frequency": [0.7, 0.8]}
FUNCTIONS = {
    f"{part.__name__}.{name}": getattr(part, name)
    for part in (vx, vx.plot, vx.models)
    for name in dir(part)
    if inspect.isfunction(getattr(part, name))
}
# What an argument cannot be, by the words of its annotation; those of machines, loads and flows are refused by the functions themselves.
WRONG = {
    "bool": object(),
    "int": {"a": 1},
    "float": "much",
    "str": 3,
    "ExecutionSettings": 8,
    "Dataset": [1, 2],
    "Bifurcation": 3,
    "Numbers": object(),
    "ArrayLike": {"a": 1},
    "Sequence[str]": 3,
    "tuple[float, float]": 3,
    "Mapping[str, str] | None": 3,
    "Axes | None": 3,
    "str | PathLike[str] | None": 3,
    "float | None": [1.0, 2.0],
    "int | None": "many",
    "Numbers | None": "much",
}
CASES = [
    (where, one.name, WRONG[str(one.annotation)])
    for where, function in FUNCTIONS.items()
    for one in inspect.signature(function).parameters.values()
    if str(one.annotation) in WRONG
]


def failing(function):
    """A function with the arguments of another that fails as Python does."""

    def fail(*args, **named):
        raise TypeError("unsupported operand")

    fail.__annotations__, fail.__signature__ = function.__annotations__, inspect.signature(function)
    return with_explained_errors(fail, "vijax")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("where", "name", "wrong"), CASES, ids=lambda one: one if isinstance(one, str) else ""
)
def test_an_argument_of_a_wrong_kind_is_named_where_a_function_fails(where, name, wrong):
    with pytest.raises(ValueError, match=f"^Argument `{name}` must be "):
        failing(FUNCTIONS[where])(**{name: wrong})


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda machine, one: vx.sweep(machine, VALUES, progress=False), "system"),
        (lambda machine, one: vx.sweep(ONE, {"forcing.frequency": one}, progress=False), "values"),
        (lambda machine, one: vx.ensemble(machine, {"forcing.frequency": norm(0.7, 0.02)}), "system"),
        (lambda machine, one: vx.plot.time_series(vx.simulate(machine, 0.0, 1.0)), "sol"),
        (lambda machine, one: vx.save(machine, "machine.toml"), "system"),
    ],
)
def test_functions_of_known_numbers_say_so_under_transformations(call, name):
    with pytest.raises(ValueError, match=rf"^Argument `{name}` must be .*known.*outside of `jax\.jit`"):
        jax.grad(lambda one: call(vx.models.impact_oscillator(0.8, one[0], position=1.0), one))(jnp.ones(1))


def test_what_neither_a_picture_nor_matplotlib_has_is_told():
    sol = vx.simulate(ONE, 0.0, 1.0)
    sentence = r"^Argument `quantity` must be one of `sol`, .*, or a property of what matplotlib draws, as `color`, but is neither."
    with pytest.raises(ValueError, match=sentence):
        vx.plot.phase_portrait(sol, quantity="x")
    assert vx.plot.phase_portrait(sol, color="red").lines


def test_errors_of_arguments_that_are_right_stay_as_they_are():
    with pytest.raises(TypeError, match="unsupported operand"):
        failing(vx.simulate)(ONE, 0.0, 1.0, [0.0], v0=None, throw=True)
    with pytest.raises(TypeError, match="unexpected keyword argument 'positon'"):
        vx.simulate(ONE, 0.0, 1.0, positon=1.0)  # pyright: ignore[reportCallIssue]


def test_there_is_a_case_for_most_arguments():
    assert len(CASES) > 400


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: vx.sweep(ONE, VALUES, settings=8), "`settings` must be a `vx.ExecutionSettings`, but is 8."),
        (lambda: vx.sweep(ONE, VALUES, quantities=3), "`quantities` must be a list, each entry a text, but is 3."),
        (lambda: vx.sweep(ONE, VALUES, carry="up", carry_from=3), "`carry_from` must be a `xarray.Dataset` or None, but is 3."),
        (lambda: vx.attractors(ONE, ([[0.0]], [[0.0]]), tolerance="low"), "`tolerance` must be a number or None, but is 'low'."),
        (lambda: vx.follow_torus(3, (0, 1)), "`point` must be a `vx.Bifurcation`, but is 3."),
        (lambda: vx.combine(3), "`datasets` must be a list, each entry a `xarray.Dataset`, but is 3."),
        (lambda: vx.plot.machine(ONE, ax=3), "`ax` must be a `matplotlib.axes.Axes` or None, but is 3."),
        (lambda: vx.models.woodpecker(inertia="much"), "`inertia` must be made of real numbers, but is 'much'."),
        (lambda: vx.find_periodic_orbits(3, ([[0.0]], [[0.0]]), 1), "`system` must be one machine"),
        (lambda: vx.with_states(3, [[0.0]], [[0.0]]), "`system` must be one machine"),
        (lambda: vx.monodromy_matrix(ONE, [0.0], 0.0), r"`v0` must have shape \(1,\), but has shape \(\)."),
        (lambda: vx.modal_restitution_matrix([1.0], {0: 0.5}), r"`modes` must have shape \(n, n\)"),
        (lambda: vx.ImpactSystem(1.5, [[0.1]], [[1.0]]), r"`mass` must have shape \(n,\)"),
        (lambda: vx.ExecutionSettings(lanes="many"), "`lanes` must be a whole number, 1 or more, but is 'many'."),
    ],
)  # fmt: skip
def test_the_sentence_says_what_it_must_be(call, sentence):
    with pytest.raises(ValueError, match=f"^Argument {sentence}"):
        call()


@pytest.mark.parametrize(
    "numbers",
    [
        1,
        1.5,
        np.float32(1),
        jnp.ones(2),
        np.ones((2, 2)),
        [1, np.float64(2)],
        [jnp.ones(2), [1, 2]],
        range(3),
        (),
    ],
    ids=repr,
)
def test_numbers_of_all_kinds_are_not_blamed(numbers):
    with pytest.raises(TypeError, match="unsupported operand"):
        failing(vx.attractors)(
            ONE, x0=numbers, fold=np.bool_(True), tolerance=np.float64(1.0), transient=np.int64(3)
        )


def test_public_functions_are_pickled_by_their_public_names():
    for where, function in FUNCTIONS.items():
        assert pickle.loads(pickle.dumps(function)) is function, where
        assert where.rpartition(".")[0] == function.__module__
