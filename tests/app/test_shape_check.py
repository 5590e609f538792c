"""The check of excited shapes: which speeds are looked at, and what is said."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from jaxgear.study._ranks import Doubtful
from jaxgear.study._shape_check import ShapeCheck, _some
from jaxgear.study._sweeping import Response, Sweep


def _response(speed: float, ratio: float, *, settled: bool = True) -> Response:
    numbers = cast(Any, SimpleNamespace(dynamic_ratio=ratio))
    return Response(speed, settled, settled, 1, 0.0, None, numbers)


def _sweep(up: list[Response], down: list[Response]) -> Sweep:
    speeds = np.array([each.speed for each in up])
    return Sweep(speeds, {"up": tuple(up), "down": tuple(down)}, (), {})


def test_the_highest_response_and_others_are_looked_at_where_there_is_one_response():
    speeds = np.arange(100.0, 500.0, 10.0)
    up = [_response(v, 2.0 if v == 230.0 else 1.5 if v == 300.0 else 1.1) for v in speeds]
    # Falling speeds find another response where the highest would be; one has not settled.
    down = [_response(v, 1.1 if v == 230.0 else 1.5 if v == 300.0 else 1.1) for v in speeds]
    down[0] = _response(100.0, 1.1, settled=False)
    places = _some(_sweep(up, down))
    assert len(places) == len(set(places)) == 4
    assert 300.0 in speeds[places]
    assert not {230.0, 100.0} & set(speeds[places])
    # Of few speeds one.
    assert list(_some(_sweep(up[18:22], down[18:22]))) == [2]
    lost = [_response(v, 1.0, settled=False) for v in speeds]
    assert _some(_sweep(up, lost)).size == 0


def test_what_is_more_than_a_hundredth_off_is_warned_of():
    speeds, none = np.array([300.0, 900.0]), np.zeros(2)
    check = ShapeCheck(speeds, 800, 200, np.array([np.nan, -0.025]), none)
    (note,) = check.notes
    assert isinstance(note, Doubtful)
    assert "largest mesh force at 900 rad/s is about 2.5 % larger" in note
    assert check.summary["error_dynamic_ratio"] == [None, -0.025]
    fine = ShapeCheck(speeds, 800, 200, np.array([0.009, np.nan]), np.array([-0.009, 0.0]))
    assert fine.notes == []
    (note,) = ShapeCheck(speeds, 800, 200, none, np.array([0.02, 0.01])).notes
    assert "RMS of transmission error at 300 rad/s is about 2 % smaller" in note
