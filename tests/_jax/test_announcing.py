"""Whoever waits for a program is told what is compiled, once, and not where no progress is wanted."""

import os
import subprocess
import sys

import pytest

import vijax as vx
from vijax import _progress
from vijax._jax.announcing import Stage, announce, is_announced
from vijax._printing import words_of_kind
from vijax._progress import says_what_compiles

CALLS = """
import jax
jax.config.update("jax_enable_x64", True)
import vijax as vx
system = vx.models.impact_oscillator(0.8)
for frequency in (0.7, 0.8):
    vx.sweep(system, {{"forcing.frequency": [frequency, 0.9]}}, transient=1, record=1{more})
"""
LINE = "sweep: compiling for 1 mass and 1 stop, once for this kind, kept for later"


def stderr_of(folder, more: str) -> str:
    environment = os.environ | {"VIJAX_PROGRAMS": str(folder)}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", CALLS.format(more=more)],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    return done.stderr


@pytest.mark.slow
def test_a_call_says_what_it_compiles_for_once_and_not_if_that_is_kept(tmp_path):
    assert stderr_of(tmp_path / "other", ", progress=False") == ""
    assert stderr_of(tmp_path, "").count(LINE) == 1
    assert LINE not in stderr_of(tmp_path, "")


@pytest.fixture
def said(monkeypatch) -> list[str]:
    """Lines that are printed from now on."""
    lines: list[str] = []
    monkeypatch.setattr(_progress, "_said", set())
    monkeypatch.setattr(_progress.tqdm, "write", lambda line, file: lines.append(line))
    return lines


def with_bar(thing, *, progress=True):
    announce(Stage.COMPILES)
    announce(Stage.COMPILES)
    return thing


def without_bar(thing):
    announce(Stage.TRACES)


def test_a_sentence_is_printed_once_for_each_call_and_kind(said):
    call, system = says_what_compiles(with_bar), vx.models.wagg_bishop_a(0.8)
    assert call(system) is call(system)
    assert said == ["with_bar: compiling for 2 masses and 2 stops, once for this kind, kept for later"]
    call(vx.models.impact_oscillator(0.8))
    assert len(said) == 2
    call(system, progress=False)
    assert len(said) == 2
    assert not is_announced()


def test_a_part_of_a_call_that_shows_no_progress_is_silent(said):
    outer = says_what_compiles(lambda thing, *, progress=True: says_what_compiles(with_bar)(thing))
    outer(vx.models.impact_oscillator(0.8), progress=False)
    assert said == []


def test_without_a_bar_a_call_prints_only_where_somebody_looks_on(said, monkeypatch):
    call = says_what_compiles(without_bar)
    call(None)
    assert said == []
    monkeypatch.setattr(_progress, "_is_interactive", lambda: True)
    call(None)
    assert said[0].startswith("without_bar: tracing for this kind of machine, once in every process")


def test_what_is_told_ends_with_the_call_that_fails(said):
    def fails(thing):
        raise ValueError("no machine")

    with pytest.raises(ValueError, match="no machine"):
        says_what_compiles(fails)(None)
    assert not is_announced()


def test_words_of_a_kind():
    load, stops = vx.Harmonic([1.0, 0.0], 0.9), [vx.Stop(0, 1.0, "upper", 0.7), vx.Stop(1, 1.0, "upper", 0.7)]
    chain = vx.chain(
        [1.0, 1.0], [0.1, 0.1], [1.0, 1.0], load, [*stops, vx.CompliantStop(0, 1.0, "lower", 9.0, 0.1)]
    )
    machine = vx.ImpactSystem(
        chain.mass, chain.damping, chain.stiffness, load, chain.stops, friction=[vx.Friction(0, 0.1)]
    )
    assert words_of_kind(machine) == "2 masses, 1 friction element, 1 compliant stop and 2 stops"
    assert words_of_kind(vx.models.duffing_oscillator(0.9)).endswith(" and a force")
