"""Reports in a real browser: all pictures are seen, and nothing is asked of anybody."""

import json

import pytest
from browser import headless_chromium

from jaxgear._cli._main import main

_SMALL = ("mesh.slices=5", "mesh.phases=16", "map.depth_um.points=5", "map.extent.points=3")
# The alternative texts of pictures that were not drawn, when all have been looked at.
_BROKEN = """
const done = arguments[0];
const each = (image) => image.decode().then(() => null, () => image.alt || "nameless");
Promise.all([...document.images].map(each)).then((found) => done(found.filter((x) => x !== null)));
"""


@pytest.mark.slow
def test_reports_open_without_an_error_or_a_request(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sets = [f"--set={each}" for each in _SMALL]
    assert main(["init", "accessory"]) == 0
    for command in ("run", "map", "modes"):
        assert main([command, "accessory.toml", "--quiet", *sets]) == 0, command
    pages = sorted(tmp_path.rglob("report.html"))
    assert len(pages) == 3
    with headless_chromium() as browser:
        for page in pages:
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
            nameless = "return [...document.images].filter((image) => !image.alt).length"
            assert browser.execute_script(nameless) == 0, page
