"""What a study costs: seconds in which JAX compiles, and all others."""

import contextvars
import threading
import time

import jax
import jax.numpy as jnp
import pytest

from jaxgear.study import _running


def test_what_compiles_within_what_compiles_counts_once(monkeypatch):
    """Spans 1 to 3 and 2 to 3, of which one has the other in it, and 2.5 to 4 beside them."""
    now = [0.0]
    monkeypatch.setattr(_running.time, "perf_counter", lambda: now[0])
    spent = _running.Clock()
    for now[0], duration in ((3.0, 1.0), (3.0, 2.0), (4.0, 1.5), (5.5, 0.5)):
        spent.note(duration)
    now[0] = 10.0
    assert spent.read() == pytest.approx((3.5, 6.5))


def test_a_clock_hears_of_those_within_it():
    with _running.clock() as outer:
        with _running.clock() as inner:
            jax.block_until_ready(jax.jit(lambda x: jnp.cosh(x) - 2.5)(jnp.ones(3)))
    assert outer.read()[0] == pytest.approx(inner.read()[0])
    assert inner.read()[0] > 0.0


@pytest.mark.parametrize("beside", [False, True])
def test_a_clock_hears_of_what_is_compiled(beside):
    def compiles():
        jax.block_until_ready(jax.jit(lambda x: jnp.sin(x) + (3.0 if beside else 4.0))(jnp.ones(3)))

    start = time.perf_counter()
    with _running.clock() as spent:
        if beside:
            thread = threading.Thread(target=contextvars.copy_context().run, args=(compiles,))
            thread.start()
            thread.join()
        else:
            compiles()
        time.sleep(0.05)
    compiling, others = spent.read()
    assert compiling > 0.0
    assert others > 0.05
    assert compiling + others <= time.perf_counter() - start
    before = spent.read()[0]
    compiles_more = jax.jit(lambda x: jnp.cos(x) - 5.0)
    jax.block_until_ready(compiles_more(jnp.ones(4)))
    assert spent.read()[0] == before
