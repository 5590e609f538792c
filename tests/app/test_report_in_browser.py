"""Reports in a real browser: all pictures are seen, and nothing is asked of anybody."""

import json

import pytest
from browser import headless_chromium

from jaxgear._cli._main import main
from jaxgear._cli._parser import ready_names
from jaxgear.report._figures import MOST_BYTES
from jaxgear.scene._scene import example_scene

_SMALL = (
    *("mesh.slices=3", "mesh.phases=12", "mesh.face_coupling=none"),
    *("map.depth_um.points=5", "map.extent.points=3"),
)
_COARSE = (
    *("fineness.rim_across=2", "fineness.web_along=2", "fineness.hub_deep=1"),
    *("modes=12", "compare_seats=false"),
)
# Of what moves, with condensed bodies.
_FEW = ("model.coordinates=40",)
_SPEEDS = "sweep.pinion_speed_rad_s=[300.0, 600.0]"
# What a command is asked beside these. Bodies are coarse: pages are looked at, no numbers.
_COMMANDS = {
    "condense": (),
    "run": (_SPEEDS,),
    "map": (),
    "modes": (),
    "sweep": (_SPEEDS,),
    "sensitivity": (),
    "optimise": (),
    "compare": (),
    "check-grad": (),
}
_HYBRID = ("condense", "run", "map", "modes", "sweep", "optimise")
# The alternative texts of pictures that were not drawn, when all have been looked at.
_BROKEN = """
const done = arguments[0];
const each = (image) => image.decode().then(() => null, () => image.alt || "nameless");
Promise.all([...document.images].map(each)).then((found) => done(found.filter((x) => x !== null)));
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ready_names())
def test_reports_open_without_an_error_or_a_request(tmp_path, monkeypatch, name):
    """Of every command that the scene has, and one of all of them."""
    with headless_chromium():
        pass  # Where there is none, that is told at once.
    monkeypatch.chdir(tmp_path)
    assert main(["init", name]) == 0
    bodies = example_scene(name).condensed
    coarse = [f"{gear}.body.{each}" for gear in bodies for each in _COARSE]
    commands = _HYBRID if bodies else [each for each in _COMMANDS if each != "condense"]
    for command in commands:
        small = (*_SMALL, *coarse, *(_FEW if bodies else ()), *_COMMANDS[command])
        sets = [f"--set={each}" for each in small]
        assert main([command, f"{name}.toml", "--quiet", *sets]) == 0, command
    _look_at(tmp_path, len(commands))
    assert main(["report", f"results/{name}"]) == 0
    _look_at(tmp_path, len(commands))


def _look_at(folder, count):
    html5lib = pytest.importorskip("html5lib")
    pages = sorted(folder.rglob("report.html"))
    assert len(pages) == count
    with headless_chromium() as browser:
        for page in pages:
            assert page.stat().st_size < MOST_BYTES
            parser = html5lib.HTMLParser()
            parser.parse(page.read_bytes())
            assert parser.errors == [], page
            browser.get(page.as_uri())
            assert browser.execute_async_script(_BROKEN) == [], page
            said = [
                json.loads(each["message"])["message"] for each in browser.get_log("performance")
            ]
            asked = [
                each["params"]["request"]["url"]
                for each in said
                if each["method"] == "Network.requestWillBeSent"
            ]
            assert page.as_uri() in asked
            assert [x for x in asked if not x.startswith((page.as_uri(), "data:"))] == [], page
            assert browser.get_log("browser") == [], page
            wide = "return document.documentElement.scrollWidth <= window.innerWidth"
            assert browser.execute_script(wide), page
            twice = "const ids = [...document.querySelectorAll('[id]')].map((each) => each.id); "
            assert browser.execute_script(twice + "return ids.length - new Set(ids).size") == 0, (
                page
            )
            nameless = "return [...document.images].filter((image) => !image.alt).length"
            assert browser.execute_script(nameless) == 0, page
