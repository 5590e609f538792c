"""Keep what commands write, or compare with what was kept: `python tests/golden --help`.

A change of numbers or of words that is meant is recorded anew, and its difference reviewed.
"""

import argparse
import concurrent.futures
import functools
import gzip
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from golden_cases import CASES
from golden_digests import differences, of_folder, of_lines
from golden_mistakes import MISTAKES, error_texts

_KEPT = Path(__file__).parent / "kept"
# Bodies come from other libraries, with threads.
_TOLERANCE, _OF_BODIES = 1e-12, 1e-9
_LISTED = 25


def computed(name: str, folder: Path) -> dict:
    """Run a case in a folder of its own, and return the digest of what it says and writes."""
    scene, command, sets = CASES[name]
    jaxgear = Path(sys.executable).with_name("jaxgear")
    here = folder / name
    shutil.rmtree(here, ignore_errors=True)
    here.mkdir(parents=True)
    subprocess.run([jaxgear, "init", scene], cwd=here, check=True, capture_output=True)
    arguments = [command, f"{scene}.toml", "--out", "out"]
    for each in sets:
        arguments += ["--set", each]
    done = subprocess.run([jaxgear, *arguments], cwd=here, capture_output=True, text=True)
    files = of_folder(here / "out")
    if command == "compare":
        # Seconds of this run are drawn in them.
        files = {name: file for name, file in files.items() if not name.endswith(".svg")}
    return {
        "exit": done.returncode,
        "output": [] if _has_bodies(name) else of_lines(done.stdout),
        "errors": done.stderr.splitlines() if done.returncode else "",
        "files": files,
    }


def _has_bodies(name: str) -> bool:
    """Whether a case condenses a body."""
    return any(".body." in each for each in CASES.get(name, ("", "", ()))[2])


def main() -> int:
    parser = argparse.ArgumentParser(prog="python tests/golden", description=__doc__)
    parser.add_argument("what", choices=("record", "check"))
    parser.add_argument("names", nargs="*", help="cases; all of them without")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, help="where results stay, to look at")
    given = parser.parse_args()
    names = given.names or [*CASES, MISTAKES]
    if unknown := set(names) - {*CASES, MISTAKES}:
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    folder = given.out or Path(tempfile.mkdtemp(prefix="golden-"))
    _KEPT.mkdir(exist_ok=True)
    wrong = 0
    with concurrent.futures.ThreadPoolExecutor(given.jobs) as pool:
        run = functools.partial(computed, folder=folder)
        waiting = {
            pool.submit(error_texts) if name == MISTAKES else pool.submit(run, name): name
            for name in names
        }
        for future in concurrent.futures.as_completed(waiting):
            name, found = waiting[future], future.result()
            file = _KEPT / f"{name}.json.gz"
            if given.what == "record":
                file.write_bytes(gzip.compress(json.dumps(found).encode(), mtime=0))
                print(f"{name}: recorded, exit {found.get('exit', 0)}", flush=True)
                continue
            was = json.loads(gzip.decompress(file.read_bytes()))
            tolerance = _OF_BODIES if _has_bodies(name) else _TOLERANCE
            lines = differences(was, json.loads(json.dumps(found)), tolerance)
            wrong += bool(lines)
            print(f"{name}: {'differs' if lines else 'the same'}", flush=True)
            changed = [line for line in lines if not line.endswith(": new")]
            for line in changed[:_LISTED]:
                print(f"    {line}")
            if len(changed) > _LISTED:
                print(f"    ... and {len(changed) - _LISTED} more")
            if len(changed) < len(lines):
                print(f"    {len(lines) - len(changed)} new")
    if given.out is None:
        shutil.rmtree(folder)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
