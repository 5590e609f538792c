"""Examples run, and say what they promise."""

import re
from pathlib import Path

import jax
import nbclient
import nbformat
import pytest

_ROOT = Path(__file__).parents[1]
_NOTEBOOKS = sorted((_ROOT / "examples").glob("*.ipynb"))


def test_there_are_examples():
    assert _NOTEBOOKS


@pytest.mark.parametrize("path", _NOTEBOOKS, ids=lambda path: path.stem)
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
    found = re.search(r"exact contact: (\d+\.\d+) um, plain (\d+\.\d+) um", text)
    assert found is not None
    assert float(found[1]) < 0.3
    assert 2.3 < float(found[2]) < 2.5


def test_the_readme_prints_what_it_says(capsys):
    """Its Python block, line by line."""
    text = (_ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) == 1
    # A user of the README has JAX's usual promotion.
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        exec(compile(blocks[0], "README.md", "exec"), {})
    printed = capsys.readouterr().out.splitlines()
    promised = [float(number) for number in re.findall(r"# (\d+\.\d+) um", blocks[0])]
    assert len(promised) == 2
    assert [round(float(line), 4) for line in printed[:2]] == promised
