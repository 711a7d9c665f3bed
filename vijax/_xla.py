"""What the compiler needs to be told."""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox.internal import unvmap_any, while_loop
from jaxtyping import Array, Bool


def compute_once(always: Bool[Array, ""], function: Callable, *args):
    """Call `function` so that XLA computes what it shares once, not once per result.

    On a CPU XLA fuses every result of a loop body separately and repeats in each whatever they share.
    A conditional ends a fusion. `always` is True, but traced, so that it is not optimised away, and
    without lanes, so that it stays a conditional.
    """
    shapes = jax.eval_shape(lambda *a: function(*a), *args)
    zeros = lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)  # noqa: E731
    return jax.lax.cond(always, lambda *a: function(*a), zeros, *args)


class AbstractTask(eqx.Module):
    """What `while_any` does: all that the loop depends on, so that derivatives see it."""

    @abc.abstractmethod
    def is_live(self, carry) -> Bool[Array, "..."]:
        """Lanes that have something left to do."""

    @abc.abstractmethod
    def step(self, carry):
        """The next carry, unchanged in every lane that is not live."""


def while_any(task: AbstractTask, carry):
    """Step while any lane is live, those of a `vmap` included. Differentiable both ways.

    A plain `while_loop` under `vmap` copies the whole carry in every step to leave the finished
    lanes alone, logs and all; here `step` does that itself, and knows how.

    Values come from an ordinary loop. Derivatives go through a loop whose memory is bounded by
    checkpoints and which JAX can transpose; it ends after 16^4 steps, far more than a motion takes
    whose derivative has any digits left. (Of the two loops that JAX or equinox offer for one of the
    two modes, each raises in the other.)
    """
    return _while_any(carry, task)


@eqx.filter_custom_jvp
def _while_any(carry, task: AbstractTask):
    return jax.lax.while_loop(lambda c: unvmap_any(task.is_live(c)), lambda c: task.step(c), carry)


@_while_any.def_jvp
def _while_any_jvp(primals, tangents):
    def bounded(carry, task):
        return while_loop(
            lambda c: unvmap_any(task.is_live(c)),
            lambda c: task.step(c),
            carry,
            max_steps=16**4,
            base=16,
            kind="bounded",
        )

    return eqx.filter_jvp(bounded, primals, tangents)
