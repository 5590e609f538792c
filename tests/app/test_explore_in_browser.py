"""The explorer's page in a real browser: sliders move, and the numbers are those of a run."""

import threading
import time

import pytest
from browser import headless_chromium

from jaxgear.explore import Explorer
from jaxgear.scene._scene import example_scene
from jaxgear.study import live_scene, statics

_DEPTHS = [f"flank.{gear}.tip_relief.depth_um" for gear in ("pinion", "wheel")]
# Milliseconds from a slider to a new picture, of rigid pairs on two quiet cores: reported.
_SLIDE = """
const done = arguments[arguments.length - 1];
const slide = document.getElementById("slide-" + arguments[0]);
slide.value = arguments[1];
const start = performance.now();
slide.dispatchEvent(new Event("input"));
const wait = () => busy ? setTimeout(wait, 20) : done(performance.now() - start);
wait();
"""


_OTHER = "pinion.shaft.bearings[0].radial_N_m"


def _add_slider(browser, key):
    """As a user does; the form is done when its button may be pressed again."""
    browser.find_element("id", "key").clear()
    browser.find_element("id", "key").send_keys(key + "\n")
    done = "return !busy && !document.querySelector('#add button').disabled"
    until = time.monotonic() + 600.0
    while not browser.execute_script(done):
        assert time.monotonic() < until, browser.find_element("id", "told").text
        time.sleep(0.2)


@pytest.fixture
def browser():
    with headless_chromium() as made:
        yield made


@pytest.mark.slow
@pytest.mark.parametrize("name", ["accessory", "power", "accessory-h1"])
def test_sliders_move_what_a_run_finds(browser, tmp_path, name):
    scene = example_scene(name)
    live = live_scene(scene)
    explorer = Explorer(live, tmp_path / "mine.toml")
    threading.Thread(target=explorer.serve, daemon=True).start()
    try:
        browser.get(explorer.address)
        until = time.monotonic() + 600.0
        while not browser.execute_script("return !busy && state.curve !== null"):
            assert time.monotonic() < until, browser.find_element("id", "told").text
            time.sleep(0.2)
        for key in _DEPTHS:
            browser.execute_async_script(_SLIDE, key, 11)
        found = browser.execute_script("return state.cycle.numbers")
        known = statics(live.scene.replace(dict.fromkeys(_DEPTHS, 11.0))).summary["static"]
        for number, value in found.items():
            assert value == pytest.approx(known[number], rel=1e-9), number
        arrow = browser.find_element("id", f"slope-{_DEPTHS[1]}")
        slopes = live.slopes(live.values(dict.fromkeys(_DEPTHS, 11.0)), "te_rms_um")
        assert float(arrow.get_attribute("data-slope")) == pytest.approx(slopes[_DEPTHS[1]])
        browser.find_element("id", "reset").click()
        browser.find_element("id", "undo").click()
        assert browser.execute_script(f"return state.values['{_DEPTHS[0]}']") == 11
        assert [each for each in browser.get_log("browser") if each["level"] == "SEVERE"] == []
        _add_slider(browser, "pinion.teeth")
        assert "no real number" in browser.find_element("id", "told").text
        _add_slider(browser, _OTHER)
        browser.execute_async_script(_SLIDE, _OTHER, 0.9 * scene.value(_OTHER))
        values, found = browser.execute_script("return [state.values, state.cycle.numbers]")
        assert values[_OTHER] == pytest.approx(0.9 * scene.value(_OTHER))
        known = statics(live.scene.replace(values)).summary["static"]
        assert found["te_rms_um"] == pytest.approx(known["te_rms_um"], rel=1e-9)
    finally:
        explorer.stop()
