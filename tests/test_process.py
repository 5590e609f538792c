"""What the operating system knows of this process."""

import math

import psutil

from jaxgear import _process


def test_the_most_memory_is_no_less_than_what_is_held_now(monkeypatch):
    held = psutil.Process().memory_info().rss / 1024**2
    assert 0.9 * held < _process.peak_memory() < psutil.virtual_memory().total / 1024**2
    # Windows does not know.
    monkeypatch.setattr(_process, "resource", None)
    assert math.isnan(_process.peak_memory())
