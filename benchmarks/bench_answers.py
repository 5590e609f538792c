"""Seconds to an answer: commands, imports and the Python of the docs, each in a fresh process.

`python benchmarks/bench_answers.py [PART ...] [--all] [--against PYTHON] [--out DIR]`

Processor seconds are what to compare, and parts are in them; seconds on the clock need a quiet
machine. "First" begins with an empty cache of compiled programs, "second" runs again with another
torque. Another version is measured as its users have it, without a cache set by variables.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from timing import one_thread

_HERE = Path(__file__).parent
_KINDS: tuple[str, ...] = ("import", "trace", "lower", "compile", "cache", "solve", "draw", "write")
# Of the second run, on the pinion [N m].
_TORQUE = {"accessory": 84.0, "power": 320.0}
_SWEPT = ["--set", "sweep.pinion_speed_rad_s={ from = 200.0, to = 3000.0, points = 60 }"]
_ANSWERED = ("run", "map", "optimise", "sweep", "modes")
_BODIES = ("run", "modes")
_CACHED = {
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}


@dataclass(frozen=True)
class Answer:
    """What one process took.

    **Fields:**

    - `processor_s`: user and system, of all its threads.
    - `wall_s`: from its start to its end.
    - `memory_MB`: its largest.
    - `parts_s`: processor seconds by kind; `solve` is what no other kind claims.
    - `code`: its exit code.
    """

    processor_s: float
    wall_s: float
    memory_MB: float
    parts_s: Mapping[str, float]
    code: int


def parted(spans: Sequence[tuple[str, float, float]], begin: float, end: float) -> dict[str, float]:
    """Seconds of each kind, where each moment belongs to the innermost span around it.

    **Arguments:**

    - `spans`: kind, begin and end of each, nested or apart [s].
    - `begin`: of all [s].
    - `end`: of all [s].

    **Returns:**

    Seconds by kind, which sum to `end - begin`; those in no span are `solve`.
    """
    seconds = dict.fromkeys(_KINDS, 0.0)
    # Of two that begin together the longer is the outer one.
    ordered = sorted(spans, key=lambda span: (span[1], -span[2]))
    open_spans, now = [("solve", end)], begin

    def until(moment: float) -> None:
        nonlocal now
        while now < moment:
            kind, closing = open_spans[-1]
            stop = min(max(closing, now), moment)
            seconds[kind] += stop - now
            now = stop
            if closing <= now and len(open_spans) > 1:
                open_spans.pop()

    for kind, opening, closing in ordered:
        until(min(opening, end))
        while len(open_spans) > 1 and open_spans[-1][1] <= now:
            open_spans.pop()
        # A clock read twice may let a span end a little after the one around it.
        open_spans.append((kind, min(closing, open_spans[-1][1])))
    until(end)
    return seconds


def answered(
    python: Path, command: Sequence[str], folder: Path, variables: Mapping[str, str]
) -> Answer:
    """Run something in a process of its own, and say what it took.

    **Arguments:**

    - `python`: interpreter of the environment that is measured.
    - `command`: `jaxgear` and its arguments, or `python` and a script.
    - `folder`: where it runs.
    - `variables`: of the environment, besides those of this process.

    **Returns:**

    Its seconds, memory and exit code.
    """
    spans = folder / "spans.json"
    spans.unlink(missing_ok=True)
    script = [str(python), str(_HERE / "answer_child.py"), str(spans), *command]
    kept = {key: value for key, value in os.environ.items() if "CACHE" not in key}
    start = time.perf_counter()
    process = subprocess.Popen(
        script,
        cwd=folder,
        env=kept | dict(variables),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    parts = parted([], 0.0, 0.0)
    if spans.exists():
        report = json.loads(spans.read_text("utf-8"))
        # JAX tells the clock's seconds only. Both clocks are read a thousand times in a command.
        moments, processor = np.transpose(report["clocks"])
        on_processor = lambda moment: float(np.interp(moment, moments, processor))
        own = [(kind, on_processor(a), on_processor(b)) for kind, a, b in report["spans"]]
        parts = parted(own, on_processor(report["begin"]), on_processor(report["end"]))
    return Answer(
        processor_s=used.ru_utime + used.ru_stime,
        wall_s=wall,
        memory_MB=used.ru_maxrss / (1024.0**2 if sys.platform == "darwin" else 1024.0),
        parts_s={kind: round(seconds, 3) for kind, seconds in parts.items()},
        code=process.returncode,
    )


def snippets() -> list[str]:
    """The Python of the docs: the first block, and the second, which goes on where that ends."""
    text = (_HERE.parent / "docs" / "python.md").read_text("utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return [blocks[0], blocks[0] + blocks[1]]


@dataclass(frozen=True)
class Rig:
    """Two versions, or one, and the folders in which they are measured.

    **Fields:**

    - `pythons`: interpreters by name.
    - `root`: a folder for each version, and one for each case in it.
    """

    pythons: Mapping[str, Path]
    root: Path

    def variables(self, name: str, case: str) -> dict[str, str]:
        """Bodies are kept throughout; compiled programs for the length of a case."""
        found = {"JAXGEAR_CACHE": str(self.root / name / "bodies")}
        if name == "this":
            programs = self.root / name / case / "programs"
            found |= {"JAX_COMPILATION_CACHE_DIR": str(programs), **_CACHED}
        return found

    def measured(self, case: str, runs: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Any]]:
        """The runs of a case, of each version in turn, so that both meet the same machine."""
        for label, command in runs.items():
            row: dict[str, Any] = {"case": case, "run": label}
            for name, python in self.pythons.items():
                folder = self.root / name / case.replace(" ", "-")
                folder.mkdir(parents=True, exist_ok=True)
                variables = self.variables(name, case.replace(" ", "-"))
                row[name] = asdict(answered(python, command, folder, variables))
            if "other" in row:
                row["ratio"] = row["other"]["processor_s"] / row["this"]["processor_s"]
            _print(row)
            yield row


def _print(row: Mapping[str, Any]) -> None:
    this = row["this"]
    parts = "  ".join(f"{kind} {seconds:.2f}" for kind, seconds in this["parts_s"].items())
    other = f"  {row['ratio']:5.1f} x less" if "ratio" in row else ""
    failed = f"  exit {this['code']}" if this["code"] else ""
    print(
        f"{row['case']:<28} {row['run']:<7} processor {this['processor_s']:6.2f} s{other}  "
        f"wall {this['wall_s']:6.2f} s  {this['memory_MB']:5.0f} MB{failed}\n    {parts}",
        flush=True,
    )


def _at_once(rig: Rig) -> list[dict[str, Any]]:
    """What should come at once."""
    (rig.root / "import.py").write_text("import jaxgear\n", "utf-8")
    (rig.root / "bad.toml").write_text("name = 3\nteeth = true\n", "utf-8")
    cases = {
        "import jaxgear": ("python", str(rig.root / "import.py")),
        "--help": ("jaxgear", "--help"),
        "init": ("jaxgear", "init", "accessory", "--force"),
        "a refused scene": ("jaxgear", "run", str(rig.root / "bad.toml")),
    }
    return [
        row
        for case, command in cases.items()
        for row in rig.measured(case, {"first": command, "second": command})
    ]


def _snippets(rig: Rig) -> list[dict[str, Any]]:
    """The Python of `docs/python.md`."""
    rows = []
    for case, code in zip(("snippet at rest", "snippet in motion"), snippets(), strict=True):
        runs = {}
        for label, torque in (("first", "torque=80.0"), ("second", "torque=84.0")):
            script = rig.root / f"{case.replace(' ', '-')}-{label}.py"
            script.write_text(code.replace("torque=80.0", torque), "utf-8")
            runs[label] = ("python", str(script))
        rows += rig.measured(case, runs)
    return rows


def _on_scene(rig: Rig, scene: str, commands: Sequence[str]) -> list[dict[str, Any]]:
    """Commands on one example scene; its condensed bodies are in the cache."""
    path = rig.root / f"{scene}.toml"
    _prepare(rig, scene)
    rows = []
    for command in commands:
        swept = _SWEPT if command == "sweep" else []
        first = ["jaxgear", command, str(path), "--quiet", "--out", "results", *swept]
        torque = _TORQUE[scene.split("-")[0]]
        second = [*first, "--set", f"pair.torque_pinion_Nm={torque}"]
        rows += rig.measured(f"{command} {scene}", {"first": first, "second": second})
    return rows


def _prepare(rig: Rig, scene: str) -> None:
    """Write an example scene, and put its condensed bodies into the cache."""
    init = ["jaxgear", "init", scene, "--force", "--out", str(rig.root)]
    for name, python in rig.pythons.items():
        folder = rig.root / name
        folder.mkdir(exist_ok=True)
        variables = rig.variables(name, "condense")
        answered(python, init, folder, variables)
        condense = ["jaxgear", "condense", str(rig.root / f"{scene}.toml"), "--out", "bodies-seen"]
        answered(python, condense, folder, variables)


def _ready() -> list[str]:
    """Names of the example scenes."""
    return sorted(path.stem for path in (_HERE.parent / "jaxgear/scene/scenes").glob("*.toml"))


def _parts(everything: bool) -> dict[str, Callable[[Rig], list[dict[str, Any]]]]:
    """What can be measured, by name."""
    chosen = {"accessory": _ANSWERED, "accessory-h1": _BODIES}
    if everything:
        chosen = dict.fromkeys(_ready(), (*_ANSWERED, "sensitivity", "compare"))
    scenes = {name: partial(_on_scene, scene=name, commands=chosen[name]) for name in chosen}
    return {"at-once": _at_once, "snippets": _snippets} | scenes


def _python_of(path: Path) -> Path:
    """The interpreter of an environment, given itself or a command beside it."""
    found = path if path.name.startswith("python") else path.with_name("python")
    # Not resolved: a link in an environment is what tells Python which environment it is in.
    return found.absolute()


def main() -> None:
    """Measure, print, and keep what was measured."""
    parser = argparse.ArgumentParser(description="Seconds to an answer.")
    parser.add_argument("parts", nargs="*", help="at-once, snippets, or example scenes")
    parser.add_argument("--all", action="store_true", help="every command on every example scene")
    parser.add_argument(
        "--against", type=Path, metavar="PYTHON", help="python or jaxgear of another environment"
    )
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    parts = _parts(options.all)
    if unknown := set(options.parts) - set(parts):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(parts)}")
    one_thread()
    options.out.mkdir(parents=True, exist_ok=True)
    pythons = {"this": Path(sys.executable)}
    if options.against:
        pythons["other"] = _python_of(options.against)
    path = options.out / "answers.json"
    report: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    with tempfile.TemporaryDirectory() as root:
        for name in options.parts or parts:
            print(f"\n{name}", flush=True)
            report[name] = parts[name](Rig(pythons, Path(root)))
            path.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"\nwritten to {path}")


if __name__ == "__main__":
    main()
