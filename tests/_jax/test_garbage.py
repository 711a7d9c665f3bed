"""Python's search for garbage is off while a program is traced, rare while branches are followed, and as before afterwards."""

import gc
import threading

import jax.numpy as jnp
import pytest

from vijax._jax.garbage import with_rare_garbage_collection, without_garbage_collection
from vijax._jax.programs import Programs


@pytest.fixture(autouse=True)
def _is_on():
    """The search is on at the start of each test, and as it was before behind it."""
    was_on = gc.isenabled()
    gc.enable()
    yield
    if not was_on:
        gc.disable()


def test_it_goes_on_behind_the_outermost_block_even_if_that_fails():
    assert gc.isenabled()
    with without_garbage_collection():
        with pytest.raises(RuntimeError, match="stop"), without_garbage_collection():
            raise RuntimeError("stop")
        assert not gc.isenabled()
    assert gc.isenabled()


def test_it_stays_off_where_the_user_has_turned_it_off():
    gc.disable()
    with without_garbage_collection():
        pass
    assert not gc.isenabled()
    gc.enable()


def test_it_waits_for_the_last_of_several_threads():
    inside, leave = threading.Event(), threading.Event()

    def other():
        with without_garbage_collection():
            inside.set()
            leave.wait(10)

    thread = threading.Thread(target=other)
    thread.start()
    inside.wait(10)
    with without_garbage_collection():
        pass
    assert not gc.isenabled()
    leave.set()
    thread.join()
    assert gc.isenabled()


def test_it_is_off_while_a_program_is_traced():
    was_on = []

    def function(x):
        was_on.append(gc.isenabled())
        return x + 1

    assert Programs(function, lambda: None)(jnp.array(1.0)) == 2
    assert was_on[0] is False
    assert gc.isenabled()


def test_it_is_rare_in_a_block_and_as_before_behind_it():
    class Ring:
        def __init__(self):
            self.own = self

    before = gc.get_threshold()
    with with_rare_garbage_collection():
        with pytest.raises(RuntimeError, match="stop"), with_rare_garbage_collection():
            raise RuntimeError("stop")
        num = gc.get_stats()[0]["collections"]
        rings = [Ring() for _ in range(10 * before[0])]
        assert gc.get_stats()[0]["collections"] == num
        del rings
        assert gc.isenabled()
    assert gc.get_threshold() == before


def test_it_stays_never_where_the_user_has_set_it_so():
    before = gc.get_threshold()
    gc.set_threshold(0, *before[1:])
    try:
        with with_rare_garbage_collection():
            assert gc.get_threshold()[0] == 0
    finally:
        gc.set_threshold(*before)
