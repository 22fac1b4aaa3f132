"""Every example and notebook runs as it stands, in an empty folder."""

import runpy
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).resolve().parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("[0-9][0-9]_*.py"))
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_the_examples_are_numbered_without_gaps_and_short():
    assert [path.name[:2] for path in EXAMPLES] == [f"{n:02}" for n in range(1, 11)]
    assert len(NOTEBOOKS) == 3
    for path in EXAMPLES:
        assert len(path.read_text().splitlines()) <= 60, path.name


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(example, tmp_path, monkeypatch, capsys):
    """In this process: one of its own takes seconds to load the kernels."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example)])
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(notebook, tmp_path):
    content = nbformat.read(notebook, as_version=4)
    nbformat.validate(content)
    cells = [cell for cell in content.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in cells), "commit notebooks without outputs"
    resources = {"metadata": {"path": str(tmp_path)}}
    client = NotebookClient(content, timeout=300, kernel_name="python3", resources=resources)
    client.execute()
    assert any(cell.outputs for cell in cells)
