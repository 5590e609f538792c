"""From a slider of the explorer to new pictures, in a headless Chromium.

    python benchmarks/bench_explore.py [--scenes accessory power] [--moves 20] [--out DIR]

Moves the depth of the pinion's tip relief again and again, and measures in the page from the
slider's event to the pictures of the mesh cycle, drawn anew, and to the end of arrows and curve.
The aim is 0.1 s to the pictures for a rigid pair on two cores. Needs `pip install -e '.[browser]'`.
Writes `explore.json`.
"""

import argparse
import json
import os
import statistics
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from timing import begin

_KEY = "flank.pinion.tip_relief.depth_um"
# Milliseconds to the pictures, and to the end of arrows and curve.
_MOVE = """
const [key, value, done] = arguments;
const slide = document.getElementById("slide-" + key);
const draw = drawCycle;
let drawn = null;
drawCycle = () => { draw(); drawn ??= performance.now(); };
slide.value = value;
const start = performance.now();
slide.dispatchEvent(new Event("input"));
const wait = () => {
  if (busy) { setTimeout(wait, 1); return; }
  drawCycle = draw;
  done([drawn - start, performance.now() - start]);
};
wait();
"""


def main() -> None:
    """Run all and print the table."""
    parser = argparse.ArgumentParser(description="From a slider to new pictures.")
    parser.add_argument("--scenes", nargs="+", default=["accessory", "power"])
    parser.add_argument("--moves", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    begin(options.out)
    report = {name: explored(name, options.moves) for name in options.scenes}
    (options.out / "explore.json").write_text(json.dumps(report, indent=2) + "\n", "utf-8")
    print(f"\nwritten to {options.out}")


def explored(name: str, moves: int) -> dict[str, Any]:
    """Time moves of one slider of an example scene [ms]."""
    from jaxgear.explore import Explorer
    from jaxgear.scene import example_scene
    from jaxgear.study import live_scene

    with tempfile.TemporaryDirectory() as folder:
        explorer = Explorer(live_scene(example_scene(name)), Path(folder) / "mine.toml")
        threading.Thread(target=explorer.serve, daemon=True).start()
        browser = _chromium()
        try:
            browser.get(explorer.address)
            while not browser.execute_script("return !busy && state.curve !== null"):
                time.sleep(0.2)
            # The first move is not counted.
            depths = [5.0 + 10.0 * (i % 2) + 0.1 * i for i in range(moves + 1)]
            found = [browser.execute_async_script(_MOVE, _KEY, depth) for depth in depths][1:]
        finally:
            browser.quit()
            explorer.stop()
    report: dict[str, Any] = {"moves": moves, "load_before": os.getloadavg()[0]}
    for part, taken in zip(("pictures", "arrows and curve"), zip(*found, strict=True), strict=True):
        report[part] = {"median": statistics.median(taken), "largest": max(taken)}
        line = f"{name}, {part}: median {statistics.median(taken):.0f} ms, most {max(taken):.0f} ms"
        print(line, flush=True)
    return report


def _chromium() -> Any:
    """Start a browser without a window."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    for each in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,1200"):
        options.add_argument(each)
    browser = webdriver.Chrome(options=options)
    browser.set_script_timeout(600)
    return browser


if __name__ == "__main__":
    main()
