"""Every key can be looked up: in the terminal, as JSON, on a page."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from jaxgear._cli._keys import matching, page
from jaxgear._cli._main import main
from jaxgear.scene._schema import BY_PATH, KEYS

_PAGE = Path(__file__).parents[2] / "docs" / "keys.md"


def test_the_page_is_what_the_schema_says():
    """`jaxgear keys --markdown > docs/keys.md` writes it anew."""
    assert _PAGE.read_text(encoding="utf-8") == page()


def test_every_key_has_a_line_on_the_page():
    """Under its table: both gears in one, and one example where keys are paths of other keys."""
    named, tables = set(), []
    for line in page().splitlines():
        if line.startswith("## "):
            tables = [name.strip("[]") for name in re.findall(r"`([^`]+)`", line)] or [""]
        elif found := re.match(r"\| `([^`]+)` \|", line):
            named |= {f"{table}.{found[1]}".strip(".") for table in tables}
    plain = {path.replace("[].", ".") for path in KEYS if not path.startswith(BY_PATH)}
    assert plain <= named
    assert all(any(path.startswith(f"{table}.") for path in named) for table in BY_PATH)


def test_the_page_is_printed(capsys):
    assert main(["keys", "--markdown"]) == 0
    assert capsys.readouterr().out == page()


def test_a_key_is_told_with_unit_bounds_default_and_meaning(capsys):
    assert main(["keys", "pressure_angle"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "pair.pressure_angle_deg",
        "    normal pressure angle",
        "    a number >= 5 and < 45 [degrees]; default 20.0",
    ]


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("PAIR.module", ["pair.module_mm"]),
        ("wheel*bore_mm", ["wheel.bore_mm"]),
        ("wheel.shaft.bearings[1].axial", ["wheel.shaft.bearings[].axial_N_m"]),
        ("newton's law", []),
        ("zero-backlash", ["pair.centre_distance_mm"]),
        ("optimise.bounds.wheel.bore", ["optimise.bounds.wheel.bore_mm"]),
        ("robust.scatter", ["robust.scatter.pair.module_mm"]),
        ("mod[", []),
    ],
)
def test_keys_are_found_by_a_part_of_their_path_or_meaning(pattern, found):
    assert [key.path for key in matching(pattern)] == found


def test_without_a_pattern_all_are_listed():
    listed = [key.path for key in matching("")]
    plain = [path for path in KEYS if not path.startswith(BY_PATH)]
    assert set(plain) <= set(listed)
    assert len(listed) == len(plain) + len(BY_PATH)


def test_json_has_all_that_is_known(capsys):
    assert main(["keys", "mesh.smoothing_um", "--json"]) == 0
    first = json.loads(capsys.readouterr().out)[0]
    assert first["key"] == "mesh.smoothing_um"
    assert (first["unit"], first["default"], first["above"]) == ("um", 0.5, 0.0)
    assert first["counts_if"] == 'mesh.contact = "smooth"'
    assert main(["keys", "--json"]) == 0
    keys = json.loads(capsys.readouterr().out)
    assert [key["key"] for key in keys] == [key.path for key in matching("")]
    assert {key["key"] for key in keys if key["required"]} >= {"pair.module_mm", "pinion.teeth"}


def test_a_name_that_is_no_key_brings_the_nearest(capsys):
    assert main(["keys", "pair.modul_mm"]) == 2
    assert "Did you mean pair.module_mm?" in capsys.readouterr().err
    assert main(["keys", "xyzzy"]) == 2
    assert "`jaxgear keys` lists all of them" in capsys.readouterr().err


def test_every_meaning_stands_alone():
    """A reader finds a key by itself, without those around it."""
    first = {path: key.doc.split(";")[0].split(":")[0] for path, key in KEYS.items()}
    leaning = re.compile(r"(the same|its|their|these|them)\b")
    short = {path: doc for path, doc in first.items() if leaning.match(doc) or " " not in doc}
    assert not short


def test_looking_up_imports_nothing_heavy():
    program = (
        "import sys\n"
        "from jaxgear._cli._main import main\n"
        "assert main(['keys', 'module']) == 0\n"
        "print(sorted({'jax', 'numpy', 'tomlkit', 'matplotlib'} & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
