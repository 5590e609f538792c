"""What a user is told: notes in order, symbols beside names, and the step that is under way."""

import io
import sys
from pathlib import Path

import pytest

from jaxgear._cli._printing import print_notes
from jaxgear._cli._terminal import Terminal
from jaxgear.study._progress import listened_by, narration, progress, say
from jaxgear.study._ranks import Doubtful, Idle, worst_first
from jaxgear.study._symbols import SYMBOLS, with_symbol


def test_notes_that_put_results_in_doubt_come_first():
    notes = [Idle("idle"), "a limit", Doubtful("wrong?"), "another", "a limit", Doubtful("off?")]
    assert worst_first(notes) == ["wrong?", "off?", "a limit", "another", "idle"]


def test_every_note_has_a_line_of_its_own(capsys):
    print_notes([f"note {i}, which is long" for i in range(9)])
    head, *lines = capsys.readouterr().out.splitlines()
    assert head == "notes"
    assert lines == [f"  - note {i}, which is long" for i in range(9)]
    print_notes([])
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("face_load_factor", "face_load_factor (K_Hbeta)"),
        ("transverse_load_factor", "transverse_load_factor (K_Halpha)"),
        ("c_gamma_alpha_N_mm_um", "c_gamma_alpha_N_mm_um (c_gammaalpha)"),
        ("dynamic_ratio_up", "dynamic_ratio_up (K_v)"),
        ("centre_distance_mm", "centre_distance_mm (a_w)"),
        ("te_rms_um", "te_rms_um"),
        ("slices", "slices"),
    ],
)
def test_symbols_stand_beside_names(key, told):
    assert with_symbol(key) == told


def test_symbols_are_told_apart_and_explained():
    assert len(set(SYMBOLS.values())) == len(SYMBOLS)
    page = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    cells = [cell.strip() for line in page.splitlines() for cell in line.split("|")[2:3]]
    explained = {symbol.strip() for cell in cells for symbol in cell.split(",")}
    assert set(SYMBOLS.values()) <= explained


class _Stream(io.StringIO):
    def isatty(self):
        return True


def test_the_step_under_way_is_shown(monkeypatch):
    """In the innermost line or bar; without one it goes nowhere."""
    shown = _Stream()
    monkeypatch.setattr(sys, "stderr", shown)
    say("nobody listens")
    with listened_by(Terminal()), narration("mesh cycle"):
        say("compiling")
        with progress(3, "search") as done:
            say("tracing")
            done(1)
        say("drawing")
    text = shown.getvalue()
    assert "nobody" not in text
    assert "mesh cycle: compiling [" in text
    assert "search:   0%" in text
    assert ", tracing]" in text
    assert text.index(", tracing]") < text.index("mesh cycle: drawing [")


def test_where_nobody_listens_nothing_is_said(monkeypatch):
    shown = _Stream()
    monkeypatch.setattr(sys, "stderr", shown)
    with narration("mesh cycle") as tell, progress(3, "search") as done:
        tell("drawing")
        say("compiling")
        done(1)
    assert shown.getvalue() == ""
