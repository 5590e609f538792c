"""A pinion on a slender shaft as Timoshenko's beams, and the same as a condensed body in bricks.

The body is solid and little thicker than its shaft, so that beam theory holds. The third bearing
makes loads depend on the stiffness of the shaft, not on its lengths alone.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import jaxgear as jg
from jaxgear.scene._scene import read_scene
from jaxgear.scene._unbalance import unbalances_of
from jaxgear.study._built import built_scene
from jaxgear.study._dynamics import dynamics_of
from jaxgear.study._statics import solve_statics
from jaxgear.study._statics_summary import mounts_summary


class _Case(NamedTuple):
    """Outer diameter of the shaft, places of its bearings and of mid-face, and its end [mm]."""

    outer: float
    bearings: tuple[float, float, float]
    gear_at: float
    end: float


# A tooth's load enters at the surface, and bends the body beneath it by 7 urad more than beams
# know, however long the shaft. On a shorter one that is more of the bearings' tilts (1.25 % on
# 420 mm, 0.65 % on 620 mm), on a longer one RMS of TE differs by more (0.6 and 1.1 %).
SLENDER = _Case(33.0, (10.0, 322.5, 510.0), 147.5, 520.0)
# A shaft with a step of 25 to 35 mm, two and a half times as long as thick between its bearings.
SHORT = _Case(25.0, (6.0, 64.0, 104.0), 35.0, 110.0)
SPEEDS = (500.0, 1500.0, 3000.0)
_BEAM = 'kind = "beam"'
_CONDENSED = """kind = "condensed"
modes = 30
compare_seats = false
teeth_mass = false
rotating_terms = true
seat_coupling = "averaging"
seat_width_mm = 4.0"""


def _text(case: _Case, body: str) -> str:
    bearings = ", ".join(
        f"{{ at_mm = {at}, radial_N_m = 1e8{', axial_N_m = 5e7' if i == 0 else ''} }}"
        for i, at in enumerate(case.bearings)
    )
    return f"""schema = 1
name = "shaft"
[pair]
module_mm = 2.0
torque_pinion_Nm = 40.0
[mesh]
slices = 10
phases = 16
face_coupling = "none"
[model]
gyroscopic = true
[sweep]
pinion_speed_rad_s = [1.0]
steps = 16
[pinion]
teeth = 20
face_width_mm = 20.0
bore_mm = 10.0
{'foundation = "ring"' if body == _BEAM else ""}
[pinion.body]
{body}
[pinion.shaft]
gear_at_mm = {case.gear_at}
{"divisions = 4" if body == _BEAM else ""}
segments = [ {{ length_mm = {case.end}, outer_mm = {case.outer}, inner_mm = 10.0 }} ]
bearings = [ {bearings} ]
[[pinion.shaft.unbalance]]
at_mm = {case.gear_at + 15.0}
moment_gmm = 20.0
[wheel]
teeth = 30
face_width_mm = 20.0
"""


class _Answer(NamedTuple):
    """What a pinion does at rest and in motion.

    **Fields:**

    - `te`: mean and RMS of transmission error [um].
    - `loads`, `tilts`: of bearings along and about S and T, `[bearing, direction]` [N, urad].
    - `natural`: lowest frequencies [Hz].
    - `critical`: lowest speeds that unbalance excites [rad/s].
    - `shaken`: amplitudes of bearings by unbalance, `[speed, bearing, direction]` [N].
    """

    te: np.ndarray
    loads: np.ndarray
    tilts: np.ndarray
    natural: np.ndarray
    critical: np.ndarray
    shaken: np.ndarray


def _beam_and_bricks(folder: Path, case: _Case) -> tuple[_Answer, _Answer]:
    """A pinion as beams and as bricks; `pytest -s` shows some of what they differ by."""
    beam, condensed = (_answer(folder, case, body) for body in (_BEAM, _CONDENSED))
    print(beam.te / condensed.te, beam.natural / condensed.natural)
    print(beam.critical / condensed.critical)
    return beam, condensed


def _answer(folder: Path, case: _Case, body: str) -> _Answer:
    path = folder / "scene.toml"
    path.write_text(_text(case, body))
    built = built_scene(read_scene(path), moving=True)
    scene, statics = built.scene, solve_statics(built)
    bearings = mounts_summary(statics)["bearings"]
    across = lambda name: np.array([[row[name][axis] for axis in "ST"] for row in bearings])
    pair = dynamics_of(built.model, built.grid_in_motion, scene)
    unbalance = unbalances_of(scene, built.model)["pinion"]
    shaken = [jg.unbalance_response(pair, unbalance, speed).bearing_load for speed in SPEEDS]
    return _Answer(
        te=np.array([float(statics.numbers[name]) for name in ("te_mean_um", "te_rms_um")]),
        loads=across("load_N"),
        tilts=across("tilt_urad"),
        natural=np.asarray(jg.pair_modes(pair).frequency)[:8],
        critical=jg.unbalance_critical_speeds(pair, unbalance)[:3],
        shaken=np.abs([np.asarray(load)[:3, :2] for load in shaken]),
    )


def _off(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference, of the largest value; `pytest -s` shows it."""
    off = float(np.max(np.abs(found - wanted)) / np.max(np.abs(wanted)))
    print(f"{off:.2%}")
    return off


@pytest.mark.slow
def test_a_slender_pinion_of_beams_is_that_of_bricks(tmp_path):
    """1 % at rest and in motion, of the largest load or tilt."""
    beam, condensed = _beam_and_bricks(tmp_path, SLENDER)
    np.testing.assert_allclose(beam.te, condensed.te, rtol=0.01)
    np.testing.assert_allclose(beam.natural, condensed.natural, rtol=0.01)
    np.testing.assert_allclose(beam.critical, condensed.critical, rtol=0.01)
    assert _off(beam.loads, condensed.loads) < 0.01
    assert _off(beam.tilts, condensed.tilts) < 0.01
    for found, wanted in zip(beam.shaken, condensed.shaken, strict=True):
        assert _off(found, wanted) < 0.01


@pytest.mark.slow
def test_how_far_a_short_stepped_pinion_of_beams_is_from_bricks(tmp_path):
    """What docs/accuracy.md says of it: beams are stiff at a step, and do not warp."""
    beam, condensed = _beam_and_bricks(tmp_path, SHORT)
    np.testing.assert_allclose(beam.te, condensed.te, rtol=0.03)
    np.testing.assert_allclose(beam.natural[:5], condensed.natural[:5], rtol=0.02)
    np.testing.assert_allclose(beam.critical, condensed.critical, rtol=0.02)
    assert _off(beam.loads, condensed.loads) < 0.03
    assert 0.02 < _off(beam.tilts, condensed.tilts) < 0.2
