"""Examples run, and say what they promise."""

import re
import subprocess
import sys
from pathlib import Path

import jax
import nbclient
import nbformat
import pytest

_ROOT = Path(__file__).parents[1]
_NOTEBOOKS = sorted((_ROOT / "examples").glob("*.ipynb"))


def test_there_are_examples():
    assert _NOTEBOOKS


def test_notebooks_are_stored_without_outputs():
    """What was printed once says nothing of today's code."""
    for path in _NOTEBOOKS:
        cells = nbformat.read(path, as_version=4).cells
        assert not [cell.outputs for cell in cells if cell.get("outputs")], path.name


def _is_promised_by_the_optimum(text: str) -> None:
    found = re.search(r"exact contact: (\d+\.\d+) um, plain (\d+\.\d+) um", text)
    assert found is not None
    assert float(found[1]) < 0.3
    assert 2.0 < float(found[2]) < 2.1
    mean = re.search(r"TE: mean (\S+) um", text)
    depths = re.findall(r"(?:: depth|that extent) (\S+) um", text)
    assert mean is not None
    assert float(mean[1]) == pytest.approx(25.5, abs=0.05)
    depth, closed = map(float, depths)
    assert closed / depth == pytest.approx(1.24, abs=0.005)


def _is_promised_by_the_shafts(text: str) -> None:
    """What its prose says, from what it prints."""
    promised = (
        (r"^weber, slices apart +(\S+) +(\S+) +(\S+)$", (9.88, 2.358, 1.0), 0.002),
        (r"^\.\.\. one update +(\S+) +(\S+) +(\S+)$", (16.43, 1.913, 1.0), 0.002),
        (r"^ring, coupled, one update +(\S+) +(\S+) +(\S+)$", (16.13, 1.895, 1.192), 0.002),
        (r"^mean TE (\S+) um, face load factor (\S+)$", (25.46, 1.203), 0.002),
        (r"^on rigid mounts (\S+) um, (\S+)$", (16.02, 1.169), 0.002),
        (r"^helix slope  0\.000 um: .* K_Hbeta (\S+)$", (1.475,), 0.002),
        (r"^1e\+08 N/m: K_Hbeta (\S+) plain, (\S+) sloped", (2.18, 1.88), 0.005),
        (r"^1e\+10 N/m: K_Hbeta (\S+) plain, (\S+) sloped", (1.39, 1.26), 0.005),
        (r"^order  1: .* alone (\S+) um$", (5.0,), 1e-4),
    )
    for pattern, numbers, tolerance in promised:
        found = re.search(pattern, text, flags=re.MULTILINE)
        assert found is not None, pattern
        assert [float(x) for x in found.groups()] == pytest.approx(numbers, rel=tolerance), pattern


def _is_promised_by_the_dynamics(text: str) -> None:
    """Two folds, a mesh mode, and a relief that takes the excitation away."""
    mesh = re.search(r"^ *9 +(\d+) +0\.7\d+ ", text, flags=re.MULTILINE)
    assert mesh is not None
    assert 8400 < float(mesh[1]) < 8900
    for name, low, high in (("before", 1.5, 1.8), ("after", 1.05, 1.15)):
        found = re.search(name + r": mean dynamic ratio (\S+), (\d+) of 40 left out", text)
        assert found is not None
        assert low < float(found[1]) < high
        assert int(found[2]) <= 2


def _is_promised_by_the_bodies(text: str) -> None:
    """Exact free frequencies and a file; its other promises are assertions of its own."""
    found = re.search(r"against the full body: (\S+)", text)
    assert found is not None
    assert float(found[1]) < 1e-8
    assert re.search(r"^n = 3: .* apart by \S+e-02$", text, flags=re.MULTILINE)


def _is_promised_by_the_hybrids(text: str) -> None:
    """A body that gives raises the mean over any rigid one; relief still takes the RMS away."""
    found = re.findall(r"mean +([\d.]+) um, RMS ([\d.]+) um", text)
    (halves, nothing, flexible), rms = ([float(row[i]) for row in found] for i in (0, 1))
    assert flexible > 1.5 * halves > 1.5 * nothing
    (relieved,) = (float(number) for number in re.findall(r"RMS ([\d.]+) um; slopes", text))
    assert relieved < 0.5 * rms[2]


def _is_promised_by_the_curves(text: str) -> None:
    """The closed form where it is exact; the rest of what its prose says, from what it prints."""
    found = re.search(r"off the closed form by (\S+) up to", text)
    assert found is not None
    assert float(found[1]) < 1e-6
    rows = re.findall(r"extent 0\.\d+: depth +(\S+) um, closed form +(\S+) um", text)
    assert len(rows) == 6
    for (rigid, closed), (thin, _) in zip(rows[:3], rows[3:], strict=True):
        assert 0.83 < float(rigid) / float(closed) < 0.87
        assert abs(float(thin) / float(rigid) - 1.0) < 0.05
    margins = [float(x) for x in re.findall(r"off by ([\d.]+) um at most", text)]
    assert len(margins) == 3
    assert 0.0 < margins[0] < margins[1] < margins[2]


def _is_promised_by_the_crowning(text: str) -> None:
    """Crowning wins a little, a slope beside it much; relief of one end raises the middle."""
    gains = dict(re.findall(r"^(\S.*), (?:least|centred) .* \(([-+]\d+) %\)", text, re.MULTILINE))
    assert -12 < int(gains["crowning"]) < -4
    assert -12 < int(gains["elliptical"]) < -4
    assert int(gains["slope + crowning"]) < -14
    found = re.findall(r"at most (\d+) MPa, left end (\d+), right end (\d+)", text)
    fast, better, still, after = ([int(x) for x in row] for row in found)
    assert fast[0] == fast[2] > better[0]
    # The peak at rest has changed ends, and is no higher.
    assert still[0] == still[2]
    assert after[0] == after[1] <= still[0]
    ends = re.findall(r"crowning .* left end (\d+) MPa", text)
    assert ends[-1] == "0"


def _is_promised_by_the_speeds(text: str) -> None:
    """One depth quietens all speeds; its slopes are asserted there."""
    worst = re.search(r"worst RMS (\S+) um plain, (\S+) um with 11 um", text)
    assert worst is not None
    assert float(worst[2]) < float(worst[1]) / 8
    assert "best depths from 11 to 14 um" in text
    rows = re.findall(r"rad/s: (\S+) um per um of relief, (\S+) um per N m", text)
    assert len(rows) == 5
    assert all(float(depth) < 0.0 < float(torque) for depth, torque in rows)


def _is_promised_by_the_robust_relief(text: str) -> None:
    """Deeper and shorter, worse on paper, a twentieth better where 95 % of the gears are."""
    pattern = r"depth (\S+) um, extent (\S+): RMS (\S+) um"
    (depth, extent, rms), (deeper, shorter, worse) = (
        map(float, row) for row in re.findall(pattern, text)
    )
    assert deeper > depth + 2.0
    assert shorter < extent - 0.02
    assert worse > 1.2 * rms
    found = re.findall(r"(?:nominal|robust): mean (\S+) um, 95 % below (\S+) um", text)
    (mean, most), (robust_mean, robust_most) = (map(float, row) for row in found)
    assert robust_mean == pytest.approx(mean, rel=0.01)
    assert robust_most == pytest.approx(0.95 * most, rel=0.01)
    assert re.search(r"^nominal: most by depth, ", text, flags=re.MULTILINE)
    assert re.search(r"^robust: most by profile slope, ", text, flags=re.MULTILINE)


def _is_promised_by_the_surrogate(text: str) -> None:
    """With gradients far fewer designs do; their errors are asserted there."""
    found = re.findall(
        r"(\d+) designs with gradients: \S+ um; values alone: (?:more than )?(\d+)", text
    )
    assert [int(count) for count, _ in found] == [16, 32, 64]
    assert all(int(alone) > 2.5 * int(count) for count, alone in found)


_PROMISES = {
    "01_scene_to_optimum": _is_promised_by_the_optimum,
    "02_shafts_and_bodies": _is_promised_by_the_shafts,
    "03_dynamics": _is_promised_by_the_dynamics,
    "04_gear_bodies": _is_promised_by_the_bodies,
    "05_hybrid_models": _is_promised_by_the_hybrids,
    "06_master_curve_rigid_to_flexible": _is_promised_by_the_curves,
    "07_crowning_at_speed": _is_promised_by_the_crowning,
    "08_designs_times_speeds": _is_promised_by_the_speeds,
    "09_robust_relief": _is_promised_by_the_robust_relief,
    "11_surrogate_from_gradients": _is_promised_by_the_surrogate,
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [pytest.param(path, id=path.stem) for path in _NOTEBOOKS],
)
def test_notebook_runs_and_its_assertions_hold(path):
    """Executed as a user would, in a kernel of its own."""
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    text = "".join(
        output.text
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if output.output_type == "stream" and output.name == "stdout"
    )
    _PROMISES[path.stem](text)


@pytest.mark.end_to_end
def test_the_readme_prints_what_it_says(capsys):
    """Its Python blocks, line by line."""
    text = (_ROOT / "README.md").read_text(encoding="utf-8")
    code = "\n".join(re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL))
    # A user of the README has JAX's usual promotion.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    promised = [float(number) for number in re.findall(r"# (\d+\.\d+) um", code)]
    assert len(promised) == 2
    assert [round(float(line), 4) for line in printed[:2]] == promised
    # More relief still lowers the variance.
    assert float(printed[2]) < 0.0


@pytest.mark.slow
def test_a_pair_has_its_derivatives_in_openmdao():
    """OpenMDAO's own comparison with central differences, in its own process as a user would."""
    # It is not among the requirements: `pip install openmdao`.
    pytest.importorskip("openmdao")
    path = _ROOT / "examples" / "10_a_pair_in_openmdao.py"
    text = subprocess.run([sys.executable, path], check=True, capture_output=True, text=True).stdout
    worst = re.search(r"central differences: (\S+)", text)
    sums = re.search(r"sum of variances (\S+) um\^2, at the optimum (\S+) um", text)
    assert worst is not None
    assert sums is not None
    assert float(worst[1]) < 1e-4
    assert float(sums[2]) < float(sums[1])
