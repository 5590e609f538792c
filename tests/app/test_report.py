"""The page of a results folder: what it says first, what it holds, and what it refuses."""

import base64
import html.parser
import json
import re

import pytest

from jaxgear._checks import InputError
from jaxgear._cli._main import main
from jaxgear.report import report
from jaxgear.report._figures import figures
from jaxgear.report._sizing_table import sizing_table
from jaxgear.report._verdicts import verdicts

_SCENE = """
name = "mine"
[pair]
module_mm = 2.0
[pinion]
teeth = 20
[wheel]
teeth = 40
[[pinion.shaft.bearings]]
at_mm = 5.0
[optimise.bounds]
"flank.pinion.tip_relief.depth_um" = [0.0, 30.0]
"""
_SUMMARY = {
    "name": "mine",
    "cite": "<b>nobody</b>",
    "versions": {"jaxgear": "0.11.0"},
    "notes": ["teeth part & meet"],
    "geometry": {"tip_diameter_pinion_mm": 44.0, "tip_diameter_wheel_mm": 84.0},
    "static": {"max_pressure_MPa": 1000.123456789, "bearings": [{"gear": "pinion", "load_N": 1.0}]},
}
_SVG = '<svg xmlns="http://www.w3.org/2000/svg"><text>torque [N m]</text><text>1.5</text></svg>'


@pytest.fixture
def folder(tmp_path):
    _written(tmp_path)
    (tmp_path / "te.svg").write_text(_SVG)
    (tmp_path / "te.csv").write_text("phase,te_um\n0,1\n")
    (tmp_path / "te_orders.csv").write_text("order,te_um\n1,1\n")
    return tmp_path


def _written(folder, **more):
    folder.mkdir(exist_ok=True)
    (folder / "scene.toml").write_text(_SCENE)
    (folder / "summary.json").write_text(json.dumps(_SUMMARY | more))


class _Balanced(html.parser.HTMLParser):
    """Elements that are open, identifiers, and what a page would ask of others."""

    def __init__(self, page):
        super().__init__()
        self.open, self.ids, self.asked, self.alts = [], [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []
        self.asked += [given[key] for key in ("src", "href") if key in given]
        self.alts += [given["alt"]] if tag == "img" else []
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_stands_alone(folder):
    """Elements are closed, identifiers are unique, nothing is asked of elsewhere, text is text."""
    page = report(folder, "run")
    found = _Balanced(page)
    assert not found.open
    assert len(found.ids) == len(set(found.ids))
    assert all(each.startswith(("data:", "#")) for each in found.asked)
    assert "<script" not in page
    assert "&lt;b&gt;nobody&lt;/b&gt;" in page
    assert "teeth part &amp; meet" in page


def test_pictures_are_told_and_their_tables_are_held(folder):
    found = _Balanced(report(folder, "run"))
    assert found.alts == ["te. torque [N m]"]
    data = [each for each in found.asked if each.startswith("data:text/csv")]
    assert [base64.b64decode(each.partition(",")[2]) for each in data] == [
        (folder / name).read_bytes() for name in ("te.csv", "te_orders.csv")
    ]


def test_room_ends_with_the_largest_tables(folder):
    """Without room for all, the largest table is named only; without any, the picture too."""
    (folder / "te_orders.csv").write_text("0\n" * 5000)
    page, left = figures(folder, 4000, folder)
    assert "te_orders.csv (beside this page)" in page
    assert page.count("data:text/csv") == 1
    assert 0 <= left < 4000
    page, left = figures(folder, 0, folder)
    assert "The picture is in te.svg, beside this page." in page
    assert (left, "base64" in page) == (0, False)
    # A page of all commands lies above their folders.
    page, _ = figures(folder, 0, folder.parent)
    assert f"The picture is in {folder.name}/te.svg, beside this page." in page


def test_table_of_a_longer_name_is_not_shown_twice(folder):
    (folder / "te_orders.svg").write_text(_SVG)
    assert report(folder, "run").count('download="te_orders.csv"') == 1


@pytest.mark.parametrize(
    ("summary", "level", "words"),
    [
        ({"optimise": {"converged": False, "reason": "too long"}}, "bad", "too long"),
        ({"optimise": {"robust": {"converged": True}}}, "good", "optimise.robust has converged"),
        (
            {"optimise": {"limits": [{"name": "te", "most": 1.0, "found": 2.0, "kept": False}]}},
            "bad",
            "te is 2, at most 1",
        ),
        ({"roots": {"safety_pinion": 0.9}}, "bad", "safety_pinion is 0.9"),
        ({"sweep": {"unsettled_count": 3}}, "bad", "3 points"),
        ({"sweep": {"unsettled_count": 0, "jumps": [{}]}}, "look", "1 jumps"),
        ({"check_grad": {"verdicts": {"WRONG": 2, "ok": 1}}}, "bad", "2 derivatives"),
        ({"check_grad": {"verdicts": {"WRONG": 0, "ok": 9}}}, "good", "9 derivatives"),
        ({"study": {"designs": 9, "computed": 7, "failed": 0}}, "look", "2 of 9 designs"),
        ({"study": {"designs": 9, "computed": 9, "failed": 4}}, "look", "Designs that failed: 4"),
        ({"study": {"designs": 9, "computed": 9, "failed": 0}}, "good", "All 9 designs"),
        ({"bodies": [{"name": "w", "largest_free_frequency_error": 0.2}]}, "bad", "20 %"),
        ({"compare": {"words": "5 slices suffice"}}, "plain", "5 slices suffice"),
        (
            {"optimise": {"before": {"a": 1.0, "b": 2.0}, "after": {"a": 1.0, "b": 1.0}}},
            "plain",
            "takes b from 2 to 1.",
        ),
    ],
)
def test_verdicts(summary, level, words):
    """What is wrong comes first, each by its level and its number."""
    found = verdicts({"notes": ["a remark"], **summary})
    assert any(each.level == level and words in each.text for each in found)
    order = ["bad", "look", "good", "plain"]
    ranks = [order.index(each.level) for each in found]
    assert ranks == sorted(ranks)


def test_sizing_has_both_gears():
    page = sizing_table({"pinion.teeth": 20, "wheel.teeth": 40}, _SUMMARY)
    text = re.sub("<[^>]+>", " ", page).split()
    assert text[text.index("teeth") :][:4] == ["teeth", "z", "20", "40"]
    assert text[text.index("d_a") :][:4] == ["d_a", "mm", "44", "84"]
    assert sizing_table({}, {"notes": []}) == ""


def test_sizing_has_the_torque_of_a_power():
    """30 kW at 6,000 rpm: 30,000 / (200 pi) N m."""
    asked = {"pair.power_kW": 30.0, "pair.speed_rpm": 6000.0}
    text = re.sub("<[^>]+>", " ", sizing_table(asked, _SUMMARY)).split()
    assert text[text.index("T_1") :][:4] == ["T_1", "N", "m", "47.7465"]
    assert text[text.index("P") :][:3] == ["P", "kW", "30"]
    assert text[text.index("n_1") :][:3] == ["n_1", "1/min", "6000"]


def test_scene_is_told_with_units_and_defaults(folder):
    page = report(folder, "run")
    for text in ("[optimise.bounds]", "flank.pinion.tip_relief.depth_um", "pinion.shaft.bearings"):
        assert text in page
    row = re.search(r'<th scope="row">module_mm</th>(.*?)</tr>', page)
    assert row is not None
    assert row[1].startswith("<td>2</td><td>mm</td><td></td><td>normal module")


def test_command_shows_all_commands_of_a_scene(folder, capsys):
    _written(folder / "modes", notes=[])
    (folder / "modes" / "te.svg").write_text(_SVG)
    assert main(["report", str(folder)]) == 0
    page = (folder / "report.html").read_text()
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    assert [f'<section id="{name}">' in page for name in ("run", "modes")] == [True, True]
    assert page.count(">Sizing<") == 1
    names = _Balanced(page).ids
    assert len(set(names)) == len(names)


def test_what_is_no_result_is_refused(folder, tmp_path, capsys):
    with pytest.raises(InputError, match="there is no summary"):
        report(tmp_path / "nothing")
    (folder / "summary.json").write_text("{")
    assert main(["report", str(folder)]) == 2
    assert "Run its command again" in capsys.readouterr().err
    (folder / "summary.json").write_text("[]")
    with pytest.raises(InputError, match="must be a table"):
        report(folder)
