"""The counts of `make measure`, on a planted tree."""

import importlib.util
from pathlib import Path

PATH = Path(__file__).parents[1] / "benchmarks" / "measure.py"


def test_each_count_finds_what_is_planted(tmp_path):
    spec = importlib.util.spec_from_file_location("measure", PATH)
    assert spec is not None
    assert spec.loader is not None
    measure = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(measure)
    planted = {
        "jaxgear/scene/_scene.py": 'def read(scene: Scene) -> dict:\n    return scene["a.b"]\n',
        "jaxgear/study/_statics.py": "from jaxgear.scene._scene import _real, read\n"
        "from fem_prep._grid import Grid\n"
        "def facts(scene: Scene) -> dict[str, float]:\n"
        '    return {"a": scene["a.b"], "b": scene.get("b"), "c": _real(scene, "c")}\n',
        "fem_prep/_grid.py": "def long():\n" + "    x = 1\n" * 400,
        "tests/test_a.py": "x = 1\n",
    }
    for name, text in planted.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    found = [now for *_, now in measure.counted(tmp_path)]
    assert found == ["6", "407", "1 / 1", "2", "3", "1", "2", "1"]
