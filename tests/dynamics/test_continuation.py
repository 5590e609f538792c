"""x."""

from dynamics import cases

from jaxgear._dynamics._continuation import continuation


def test_x():
    c = continuation(cases.sdof_parametric(), 0.4, 2.6)
    assert len(c.folds) == 2
