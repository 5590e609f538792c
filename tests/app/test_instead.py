"""Numbers as drawings and drives have them: what they stand for, and what they exclude."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxgear as jg
from jaxgear import mm
from jaxgear.scene._build import model_of, pair_of
from jaxgear.scene._rewriting import write_scene
from jaxgear.scene._scene import SceneError, read_scene
from jaxgear.scene._schema import GEARS, KEYS, REAL_KEYS
from jaxgear.study._dynamics import speeds_of

# A helical pair, its wheel with an odd number of teeth; by coefficients, and by its drawing.
_PAIR = """\
schema = 1
[pair]
module_mm = 3.0
helix_angle_deg = 15.0
torque_pinion_Nm = 120.0
[pinion]
teeth = 24
face_width_mm = 30.0
bore_mm = 25.0
profile_shift = 0.4
addendum_coeff = 0.96
dedendum_coeff = 1.31
thickness_allowance_um = 40.0
[wheel]
teeth = 41
face_width_mm = 30.0
bore_mm = 40.0
profile_shift = -0.1
dedendum_coeff = 1.31
"""
_COEFFICIENTS = ("profile_shift", "addendum_coeff", "dedendum_coeff")
_TORQUE = "torque_pinion_Nm = 120.0"


@pytest.fixture
def drawn(write):
    """The pair by tip and root diameters, the pinion's span, the wheel's measure over balls."""
    pair = pair_of(read_scene(write(_PAIR)))
    balls = jnp.asarray([5.5, 5.25]) * mm
    spans, over = jg.span_measure(pair, jnp.asarray([4.0, 5.0])), jg.ball_measure(pair, balls)
    text, tips, roots = _PAIR, 2e3 * pair.tip_radius, 2e3 * pair.root_radius
    for table, measure in (
        ("pinion", f"span_mm = {float(spans[0]) / mm!r}\nspan_teeth = 4"),
        ("wheel", f"over_balls_mm = {float(over[1]) / mm!r}\nball_mm = 5.25"),
    ):
        tip, root = (float(each[GEARS.index(table)]) for each in (tips, roots))
        own = f"[{table}]\n{measure}\ntip_diameter_mm = {tip!r}\nroot_diameter_mm = {root!r}"
        text = text.replace(f"[{table}]", own)
    lines = [x for x in text.splitlines() if not x.startswith(_COEFFICIENTS)]
    return "\n".join(lines) + "\n"


def _mistakes(path, overrides=()):
    with pytest.raises(SceneError) as caught:
        read_scene(path, overrides)
    return caught.value.mistakes


def test_a_drawing_gives_the_coefficients_back(write, drawn):
    """To rounding, the thinner teeth of the pinion in its span."""
    by_coefficients, by_drawing = read_scene(write(_PAIR)), None
    by_drawing = read_scene(write(drawn))
    for gear in GEARS:
        for key in _COEFFICIENTS:
            path = f"{gear}.{key}"
            assert path not in by_drawing.values
            assert by_drawing.value(path) == pytest.approx(by_coefficients.value(path), abs=1e-12)
    one, other = pair_of(by_coefficients), pair_of(by_drawing)
    assert np.allclose(one.tip_radius, other.tip_radius, rtol=1e-14)
    assert np.allclose(one.form_radius, other.form_radius, rtol=1e-12)


def test_what_is_written_reads_back(write, drawn, tmp_path):
    scene = read_scene(write(drawn))
    write_scene(scene, tmp_path / "again.toml")
    again = read_scene(tmp_path / "again.toml")
    assert dict(again.values) == dict(scene.values) | {"name": "scene"}
    assert again.value("wheel.profile_shift") == scene.value("wheel.profile_shift")


def test_power_and_speed_give_the_torque(write):
    """30 kW at 3000 rpm: 30e3 / (100 pi) N m."""
    scene = read_scene(write(_PAIR.replace(_TORQUE, "power_kW = 30.0\nspeed_rpm = 3000.0")))
    assert scene.value("pair.torque_pinion_Nm") == pytest.approx(300.0 / math.pi, rel=1e-14)
    assert {"pair.power_kW", "pair.speed_rpm"} <= set(scene.real_keys())
    # A speed beside a torque is told, and does nothing.
    beside = read_scene(write(_PAIR), ["pair.speed_rpm=3000"])
    assert "pair.speed_rpm" not in beside.real_keys()


@pytest.mark.parametrize(
    ("speeds", "found"),
    [
        ("[300.0, 3000.0]", [300.0, 3000.0]),
        ("{ from = 600, to = 900, points = 3 }", [600, 750, 900]),
    ],
)
def test_sweeps_take_revolutions_per_minute(write, speeds, found):
    scene = read_scene(write(f"{_PAIR}[sweep]\npinion_speed_rpm = {speeds}\n"))
    assert speeds_of(scene.sweep) == pytest.approx(np.asarray(found) * math.pi / 30.0, rel=1e-14)


def test_a_number_of_its_own_takes_the_place_of_what_stood_for_it(write, drawn):
    scene = read_scene(write(drawn.replace(_TORQUE, "power_kW = 30.0\nspeed_rpm = 3000.0")))
    loaded = scene.replace({"pair.torque_pinion_Nm": 50.0, "pinion.profile_shift": 0.2})
    assert (loaded.value("pair.torque_pinion_Nm"), loaded.value("pinion.profile_shift")) == (
        50.0,
        0.2,
    )
    assert not {"pair.power_kW", "pinion.span_mm"} & set(loaded.values)
    again = loaded.replace({"pair.power_kW": 60.0, "wheel.over_balls_mm": 131.0})
    assert again.value("pair.torque_pinion_Nm") == pytest.approx(600.0 / math.pi)
    assert again.value("wheel.profile_shift") != scene.value("wheel.profile_shift")
    # The tip stays where it was drawn.
    assert again.value("pinion.addendum_coeff") > scene.value("pinion.addendum_coeff") + 0.19


def test_models_follow_what_is_drawn(write, drawn):
    """Derivatives by tip and root diameters, spans, balls and power are those of the geometry."""
    scene = read_scene(write(drawn.replace(_TORQUE, "power_kW = 30.0\nspeed_rpm = 3000.0")))

    keys = (
        "pinion.span_mm",
        "wheel.over_balls_mm",
        "pinion.tip_diameter_mm",
        "wheel.root_diameter_mm",
        "pair.power_kW",
        "pair.speed_rpm",
    )

    def facts(x):
        model = model_of(scene.replace(dict(zip(keys, x, strict=True))))
        pair = model.pair
        shifts = pair.of_bodies("profile_shift")
        return shifts[0], shifts[1], pair.tip_radius[0], pair.root_radius[1], model.torque

    at = np.asarray([scene.value(key) for key in keys])
    slopes = np.asarray(jax.jit(jax.jacfwd(facts))(at))
    assert slopes[0, 0] == pytest.approx(1.0 / (6.0 * math.sin(math.radians(20.0))), rel=1e-12)
    step = np.asarray([0.0, 1e-3, 0.0, 0.0, 0.0, 0.0])
    central = (facts(at + step)[1] - facts(at - step)[1]) / 2e-3
    assert slopes[1, 1] == pytest.approx(float(central), rel=1e-6)
    # Half a millimetre of radius for one of diameter, whatever the span.
    assert slopes[2] == pytest.approx([0.0, 0.0, 0.5e-3, 0.0, 0.0, 0.0], abs=1e-15)
    assert slopes[3] == pytest.approx([0.0, 0.0, 0.0, 0.5e-3, 0.0, 0.0], abs=1e-15)
    torque = scene.value("pair.torque_pinion_Nm")
    assert slopes[4, 4:] == pytest.approx([torque / 30.0, -torque / 3000.0], rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "path", "words"),
    [
        (_TORQUE, f"{_TORQUE}\npower_kW = 9.0\nspeed_rpm = 900.0", "pair.power_kW",
         "repeats or contradicts pair.torque_pinion_Nm ({path}:5)"),
        (_TORQUE, "power_kW = 9.0", "pair.power_kW", "needs pair.speed_rpm: speed of the pinion"),
        (_TORQUE, "", "pair.torque_pinion_Nm", "Or write pair.power_kW and pair.speed_rpm"),
        ("dedendum_coeff = 1.31\nt", "dedendum_coeff = 1.31\nroot_diameter_mm = 68.0\nt",
         "pinion.root_diameter_mm", "repeats or contradicts pinion.dedendum_coeff ({path}:12)"),
        ("addendum_coeff = 0.96", "tip_diameter_mm = 8.2", "pinion.tip_diameter_mm",
         "got 8.2, which makes pinion.addendum_coeff impossible: got -11.4"),
        ("addendum_coeff = 0.96", "tip_diameter_mm = 82.0\ntip_shortening_coeff = 0.1",
         "pinion.tip_shortening_coeff", "contradicts pinion.tip_diameter_mm ({path}:11)"),
        ("profile_shift = 0.4", "span_mm = 33.0\nspan_teeth = 4\nover_balls_mm = 83.0\nball_mm = 5",
         "pinion.over_balls_mm", "repeats or contradicts pinion.span_mm ({path}:10)"),
        ("profile_shift = 0.4", "over_balls_mm = 60.0\nball_mm = 5.0", "pinion.over_balls_mm",
         "got 60.0: balls so low would lie within the base circle"),
        ("profile_shift = 0.4", "over_balls_mm = 60.0", "pinion.over_balls_mm",
         "needs pinion.ball_mm: diameter of a ball"),
        ("profile_shift = 0.4", "span_mm = 33.0\nspan_teeth = 5", "pinion.span_teeth",
         "Did the drawing count 4?"),
    ],
)  # fmt: skip
def test_two_for_one_or_half_of_one_is_refused(write, old, new, path, words):
    assert old in _PAIR
    file = write(_PAIR.replace(old, new, 1))
    mistakes = {mistake.path: mistake.message for mistake in _mistakes(file)}
    assert [*mistakes] == [path]
    assert words.format(path=file) in mistakes[path]


def test_two_units_of_speed_are_refused_once(write):
    text = f"{_PAIR}[sweep]\npinion_speed_rad_s = [90.0]\npinion_speed_rpm = {{ from = 9 }}\n"
    paths = [mistake.path for mistake in _mistakes(write(text))]
    assert paths.count("sweep.pinion_speed_rpm") == 1


def test_searches_name_what_was_written(write, drawn):
    """Not what follows from it; but torques scatter wherever they come from."""
    text = drawn.replace(_TORQUE, "power_kW = 30.0\nspeed_rpm = 3000.0")
    vary = '[optimise]\nvary = ["pinion.tip_diameter_mm", "wheel.profile_shift"]\n'
    (mistake,) = _mistakes(write(text + vary))
    assert "is given by wheel.over_balls_mm" in mistake.message
    vary = '[optimise]\nvary = ["pinion.tip_diameter_mm"]\n[robust.scatter]\n'
    read_scene(write(text + vary + '"pair.torque_pinion_Nm" = 3.0\n'))
    (mistake,) = _mistakes(write(text + vary + '"pair.power_kW" = 3.0\n'))
    assert "let pair.torque_pinion_Nm scatter" in mistake.message


def test_a_slip_is_told_where_it_was_written(write):
    text = _PAIR.replace(_TORQUE, "power_kW = 30000.0\nspeed_rpm = 3.0")
    (mistake,) = _mistakes(write(text))
    assert (mistake.path, mistake.where) == ("pair.power_kW", f"{write(text)}:5")


def test_what_stands_for_a_variable_is_one():
    """Of differentiable keys; the rest are counts and speeds of sweeps."""
    stands = [key for key in KEYS.values() if key.instead_of]
    assert len(stands) == 13
    for key in stands:
        assert key.instead_of in KEYS
        assert (key.path in REAL_KEYS) == (key.instead_of in REAL_KEYS)
        assert key.kind == KEYS[key.instead_of].kind
