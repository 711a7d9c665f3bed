"""Settings of all tests: 64-bit numbers, no silent broadcasting, annotations checked."""

import gc
import os
import sys
import zlib
from collections.abc import Iterator
from importlib.metadata import version

# Most of the time goes into compiling programs that run for milliseconds. They are compiled without optimisation,
# unless `VIJAX_COMPILE_FULLY=1` requests the programs that users get.
if not os.environ.get("VIJAX_COMPILE_FULLY"):
    short_way = [
        "--xla_backend_optimization_level=0",
        "--xla_disable_hlo_passes=post_scatter_expansion_simplification"
        ",while-loop-invariant-code-motion,tree_reduction_rewriter,reshape-mover",
    ]
    if tuple(map(int, version("jaxlib").split(".")[:2])) < (0, 11):  # later ones end the process at this flag
        short_way.append("--xla_cpu_use_fusion_emitters=false")
    os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *short_way])

import jax
import jaxtyping
import pytest
from jax.experimental.compilation_cache.compilation_cache import reset_cache

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

# Before anything imports vijax, so that beartype also checks calls inside the package. To check all takes half as long again,
# and tests call the same functions: checked are the first parameter sets of one test in four, chosen by their names.
# `VIJAX_CALLS_CHECKED=all` checks all, as the nightly run does; `VIJAX_CALLS_UNCHECKED=1` none.
_ALL_CHECKED = os.environ.get("VIJAX_CALLS_CHECKED") == "all"
if not os.environ.get("VIJAX_CALLS_UNCHECKED"):
    jaxtyping.install_import_hook("vijax", "beartype.beartype")
_started: set[str] = set()

pytest.register_assert_rewrite("helpers", "outputs")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--part K/N`: a file of tests is in one of N parts, by its name."""
    parser.addoption(
        "--part", metavar="K/N", help="run one part of N of the files of tests, K from 0 to N - 1"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the tests of other parts out."""
    if part := config.getoption("part"):
        number, parts = map(int, part.split("/"))
        chosen = [i for i in items if zlib.crc32(i.path.name.encode()) % parts == number]
        config.hook.pytest_deselected(items=[i for i in items if i not in set(chosen)])
        items[:] = chosen


def pytest_configure(config: pytest.Config) -> None:
    """Keep compiled programs beside pytest's own cache, so that a second run or another process need not compile again.

    All of them are kept, since a run has many hundred small ones, except those that call back into Python.
    """
    if getattr(config, "cache", None) is not None:
        settings = {
            "jax_persistent_cache_min_compile_time_secs": 0,
            "jax_persistent_cache_min_entry_size_bytes": -1,
            "jax_compilation_cache_dir": str(config.cache.mkdir("jax")),
        }
        for name, value in settings.items():
            jax.config.update(name, value)
            os.environ[name.upper()] = str(value)  # for the processes that tests start
        os.environ["VIJAX_PROGRAMS"] = str(config.cache.mkdir("programs"))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Check annotations in the first parameter set of one test in four."""
    function = item.nodeid.partition("[")[0]
    is_checked = function not in _started and zlib.crc32(function.encode()) % 4 == 0
    jaxtyping.config.update("jaxtyping_disable", not (is_checked or _ALL_CHECKED))
    _started.add(function)


@pytest.fixture(scope="module", autouse=True)
def _collected_once() -> Iterator[None]:
    """Collect garbage once a file, and only new objects.

    Tracing makes millions of small, long-lived objects. Traversing all of them repeatedly took a tenth of the time of
    all tests.
    """
    gc.disable()
    yield
    gc.collect(1)


@pytest.fixture(autouse=True)
def _figures_closed() -> Iterator[None]:
    """Close the figures of a test, so that the next one counts only its own."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def no_other_cache() -> Iterator[None]:
    """What JAX loads from its own cache is not stored."""
    jax.config.update("jax_enable_compilation_cache", False)
    reset_cache()
    yield
    jax.config.update("jax_enable_compilation_cache", True)
    reset_cache()


@pytest.fixture
def optimised_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops over lanes are compiled with all optimisations, for tests whose runs would take longer than that."""
    from vijax._jax.compiler_options import FOR_LANES

    monkeypatch.setitem(FOR_LANES, "xla_backend_optimization_level", 3)
