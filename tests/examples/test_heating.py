"""docs/migration/5-mosaik.md: both programs run, and their temperatures are equal."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mosaik", reason="the extra docs installs mosaik")

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "heating"
PAGE = (ROOT / "docs" / "migration" / "5-mosaik.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)


def python(*words, folder):
    return subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False
    )


def test_the_page_shows_the_programs():
    assert BLOCKS[0] == (FOLDER / "heating.py").read_text(encoding="utf-8")
    assert BLOCKS[1] == (FOLDER / "heating_mosaik.py").read_text(encoding="utf-8")


def test_both_programs_have_the_same_temperatures():
    done = python("-c", BLOCKS[2], folder=ROOT)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("program", ["heating.py", "heating_mosaik.py"])
def test_a_program_prints_temperatures(program):
    done = python(program, folder=FOLDER)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "17.74" in done.stdout
