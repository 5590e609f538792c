"""What the drawing of each gear says: diameters, and measures of tooth thickness."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxgear._geometry._measures import (
    ball_measure,
    ball_radius,
    span_measure,
    span_radius,
    usual_ball,
    usual_span,
)
from jaxgear._geometry._pair import GearPair
from jaxgear._kept_programs import called
from jaxgear._types import Bodies
from jaxgear._units import mm
from jaxgear.scene._gear_tables import GearKeys
from jaxgear.scene._schema import GEARS
from jaxgear.study._result import Summary

_CIRCLES = ("tip", "root", "form", "base", "reference", "working_pitch")


def drawing_summary(gears: Mapping[str, GearKeys], pair: GearPair) -> Summary:
    """Diameters, spans and measures over balls of both gears, by their keys in the summary.

    Spans are over `span_teeth` teeth and measures over balls of `ball_mm` where the scene names
    them, else over what is measured midway up the teeth. NaN where that would not touch an involute
    between its form and its tip circle, or a ball not stand out beyond the tips.
    """
    given = [(gears[gear].span_teeth, gears[gear].ball_mm) for gear in GEARS]
    teeth, ball = np.asarray(given, dtype=float).T
    found = jax.tree.map(np.asarray, called(_measured, pair, teeth, ball * mm))
    circles = zip(_CIRCLES, found.diameters, strict=True)
    rows = {f"{name}_diameter": each for name, each in circles}
    rows |= {"span": found.span, "ball": found.ball, "over_balls": found.over_balls}
    summary = {}
    for body, gear in enumerate(GEARS):
        for name in sorted([*rows, "span_teeth"]):
            if name == "span_teeth":
                summary[f"{name}_{gear}"] = float(found.span_teeth[body])
            else:
                summary[f"{name}_{gear}_mm"] = float(rows[name][body]) / mm
    return summary


class _Measures(NamedTuple):
    """Diameters of the circles, number of teeth spanned, span, ball, measure over balls [m, -]."""

    diameters: tuple[Bodies, ...]
    span_teeth: Bodies
    span: Bodies
    ball: Bodies
    over_balls: Bodies


def _measured(pair: GearPair, spanned: Bodies, ball: Bodies) -> _Measures:
    """All of it at once; NaN asks for the usual span or ball."""
    usual = jnp.round(usual_ball(pair) / (0.05 * pair.normal_module)) * 0.05 * pair.normal_module
    spanned = jnp.where(jnp.isnan(spanned), usual_span(pair), spanned)
    ball = jnp.where(jnp.isnan(ball), usual, ball)

    def touching(measure: Bodies, radius: Bodies) -> Bodies:
        inside = (pair.form_radius <= radius) & (radius <= pair.tip_radius)
        return jnp.where(inside, measure, jnp.nan)

    over_balls = touching(ball_measure(pair, ball), ball_radius(pair, ball))
    proud = over_balls > 2.0 * pair.tip_radius
    return _Measures(
        diameters=tuple(2.0 * getattr(pair, f"{name}_radius") for name in _CIRCLES),
        span_teeth=spanned,
        span=touching(span_measure(pair, spanned), span_radius(pair, spanned)),
        ball=ball,
        over_balls=jnp.where(proud, over_balls, jnp.nan),
    )
