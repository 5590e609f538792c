"""The public set of reference results: its reader, its judge, a cheap case and its page."""

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_LINES = "case,number,value\n"


@pytest.fixture(scope="module")
def parts():
    """The modules of the set, by name."""
    sys.path.insert(0, str(ROOT))
    try:
        names = ("cases", "judge", "page", "runs")
        yield {name: importlib.import_module(f"benchmarks.reference.{name}") for name in names}
    finally:
        sys.path.remove(str(ROOT))


@pytest.fixture(scope="module")
def cases(parts):
    return parts["cases"].read_cases()


def test_every_case_says_where_it_is_from(parts, cases):
    assert len(cases) >= 12
    for case in cases.values():
        assert case.origin
        assert set(case.levels) <= set(parts["runs"].LEVELS)
        assert all(known.value != 0.0 < known.within_percent for known in case.numbers.values())


def test_a_form_is_filled_and_judged(parts, cases, tmp_path):
    """What is known lies within its bounds, what is off does not; nothing given is missing."""
    form, judge = tmp_path / "form.csv", parts["judge"]
    judge.write_blank(form, cases)
    assert {each.verdict for each in judge.judged(form, cases)} == {"missing"}
    rows = [
        f"{case.case},{name},{known.value!r}\n"
        for case in cases.values()
        for name, known in case.numbers.items()
    ]
    form.write_text(_LINES + "".join(rows))
    assert {each.verdict for each in judge.judged(form, cases)} == {"within"}
    name, known = next(iter(cases["fzg-c"].numbers.items()))
    off = known.value * (1.0 - 0.011 * known.within_percent)
    form.write_text(f"{_LINES}fzg-c,{name},{off!r}\n")
    (found,) = judge.judged(form, cases)
    assert found.verdict == "outside"
    assert found.error_percent == pytest.approx(-1.1 * known.within_percent)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_LINES + "fzg-d,static.te_rms_um,1\n", "form.csv:2: fzg-d static.te_rms_um is not in"),
        (_LINES + "fzg-c,static.te_rms,1\n", "form.csv:2: fzg-c static.te_rms is not in"),
        (_LINES + "fzg-c,static.te_rms_um,7 um\n", "form.csv:2: .*'7 um' is no number"),
        (_LINES + 2 * "fzg-c,static.te_rms_um,7\n", "form.csv:3: .*twice"),
        ("case,value\n", "form.csv:1: columns number are missing"),
        (_LINES + "fzg-c,static.te_rms_um\n", "form.csv:2: .*fewer columns"),
    ],
)
def test_mistakes_in_a_form_are_told_by_line(parts, cases, tmp_path, text, words):
    (tmp_path / "form.csv").write_text(text)
    with pytest.raises(ValueError, match=words):
        parts["judge"].judged(tmp_path / "form.csv", cases)


def test_a_plate_as_the_command_runs_it(parts, cases):
    """Few elements: what bends most is furthest off, and too stiff."""
    rows = {row.number: row for row in parts["runs"].rows_of([cases["plate-05"]], ["coarse"])}
    assert rows.keys() == cases["plate-05"].numbers.keys()
    few, many = rows["disc.axial_0_Hz"], rows["disc.axial_4_Hz"]
    assert few.verdict == "within"
    assert many.verdict == "outside"
    assert 1.0 < many.error_percent < 20.0
    assert many.value == pytest.approx(many.known * (1.0 + 0.01 * many.error_percent))


@pytest.mark.slow
def test_a_plate_is_met_more_closely_with_more_elements(parts, cases):
    rows = list(parts["runs"].rows_of([cases["plate-05"]], ["coarse", "default", "fine"]))
    worst = [
        max(abs(row.error_percent) for row in rows if row.level == level)
        for level in ("coarse", "default", "fine")
    ]
    assert worst[0] > 2.0 * worst[1] > 4.0 * worst[2]
    assert all(row.verdict == "within" for row in rows if row.level == "fine")


def test_the_page_has_the_recorded_run(parts, cases):
    """Made by `python -m benchmarks.reference --page`, of all cases and levels there are."""
    page, runs = parts["page"], parts["cases"].read_rows(parts["page"].RECORDED, ("case", "level"))
    assert {(row["case"], row["level"]) for _, row in runs} == {
        (case.case, level) for case in cases.values() for level in case.levels
    }
    text = (ROOT / "docs" / "reference_set.md").read_text(encoding="utf-8")
    assert page.table_of(page.RECORDED) in text
