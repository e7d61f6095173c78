"""The notebooks of the documentation have no outputs; on demand, they run as scripts.

tests/documents/test_site.py runs each in a clean kernel, and a cell that fails ends its build;
the extension `notebook` runs them in JupyterLab.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PAGES = sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb"))


@pytest.fixture(autouse=True)
def own_runtime_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path):
    import nbformat  # late: each worker imports all test modules

    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)


@pytest.mark.slow
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_a_notebook_runs_as_a_script(path, tmp_path):
    from nbconvert import PythonExporter  # late, too

    code, _ = PythonExporter().from_filename(str(path))
    script = tmp_path / f"{path.stem}.py"
    script.write_text(code, encoding="utf-8")
    environment = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
