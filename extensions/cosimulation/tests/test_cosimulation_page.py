"""extensions/cosimulation/cosimulation.md runs, from its first block to its last."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

for library in ("mosaik", "helics", "fmpy", "pythonfmu3"):
    if not find_spec(library):
        pytest.skip(f"needs {library} (pip install {library})", allow_module_level=True)

ROOT = Path(__file__).parents[3]
PAGE = Path(__file__).parents[1] / "cosimulation.md"


@pytest.fixture(scope="module")
def sections():
    """The text before the section about FMI, and this section."""
    return PAGE.read_text(encoding="utf-8").split("\n## FMI\n")


def ran(section, folder):
    """What the Python blocks of a section print, in one process."""
    (folder / "examples").symlink_to(ROOT / "examples")
    program = "\n".join(re.findall(r"```python\n(.*?)```", section, re.S))
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_mosaik_and_helics_step_a_room(sections, tmp_path):
    checked = sections[0] + "\n```python\nprint(len(heating_mosaik.ROWS))\n```\n"
    printed = ran(checked, tmp_path)
    assert "4 18.163" in printed
    # HELICS may add a warning as the process ends: a federate left while a value was on its way.
    assert "100" in printed.splitlines()


def test_fmpy_steps_an_exported_world(sections, tmp_path):
    ran(sections[1], tmp_path)
    assert (tmp_path / "flock.fmu").is_file()
