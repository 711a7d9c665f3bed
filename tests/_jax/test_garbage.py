"""Python's search for garbage is off while a program is traced, and as before afterwards."""

import gc
import threading

import jax.numpy as jnp
import pytest

from vijax._jax.garbage import without_garbage_collection
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
