"""Imports: names of the package on first access, and modules of users as they are now."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import minerva_bus
from minerva_bus.errors import WorldFileError
from minerva_bus.launch.specs import load


@pytest.mark.parametrize("name", minerva_bus.__all__)
def test_every_public_name_is_there(name):
    assert getattr(minerva_bus, name) is not None
    assert name in dir(minerva_bus)


def test_all_names_that_can_be_imported_are_public():
    listed = [name for names in minerva_bus._HOMES.values() for name in names.split()]
    assert sorted(listed) == sorted(minerva_bus.__all__)


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'Fox'"):
        _ = minerva_bus.Fox


def test_the_package_alone_brings_no_numpy():
    said = "import sys, minerva_bus; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


READ = """
import sys
from pathlib import Path
from minerva_bus.launch.specs import load
print(load(sys.argv[1], Path(sys.argv[2])))
"""


def read(spec: str, folder: Path) -> str:
    """A module's attribute, in a new process, as a run reads it."""
    words = [sys.executable, "-c", READ, spec, str(folder)]
    # The tests may run without compiled files, of which this is about.
    env = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=env)
    return done.stdout.strip()


@pytest.mark.parametrize("name", ["garden", "farm.garden"])
def test_an_edit_of_the_same_size_in_the_same_second_counts(tmp_path, name):
    path = tmp_path.joinpath(*name.split(".")).with_suffix(".py")
    path.parent.mkdir(exist_ok=True)
    for value, microseconds in ((1, 100), (2, 300), (3, 300_000)):
        path.write_text(f"SIZE = {value}\n", encoding="utf-8")
        os.utime(path, ns=(10**18, 10**18 + 1000 * microseconds))
        assert read(f"{name}:SIZE", tmp_path) == str(value)
    # Compiled files are still used, so that a start costs no more.
    assert list(path.parent.joinpath("__pycache__").glob("garden.*.pyc"))


@pytest.mark.parametrize("name", ["types", "sys"])
def test_a_file_with_the_name_of_another_module_is_named(tmp_path, name, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    beside = tmp_path / f"{name}.py"
    beside.write_text("class Cart: pass\n", encoding="utf-8")
    with pytest.raises(
        WorldFileError, match=rf"{name} has no Cart \(.*, so {beside} is not imported"
    ):
        load(f"{name}:Cart", tmp_path)


INSTALLED = """
import sys
from pathlib import Path
from minerva_bus.launch.specs import search
search(Path(sys.argv[1]))
sys.path.insert(0, sys.argv[2])
import tool
print(type(tool.__loader__).__name__)
"""


def test_installed_modules_beside_a_world_file_keep_their_compiled_files(tmp_path):
    packages = tmp_path / "site-packages"
    packages.mkdir()
    (packages / "tool.py").write_text("SIZE = 1\n", encoding="utf-8")
    words = [sys.executable, "-c", INSTALLED, str(tmp_path), str(packages)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "SourceFileLoader"


VIEW = """
import sys
from pathlib import Path
from minerva_bus.launch.specs import find_view
print(find_view("plain_view:Plain", Path(sys.argv[1])).__doc__)
"""
PLAIN = """
from minerva_bus import Device

class Plain(Device, draws=("ePicture",)):
    "{place}"
"""


@pytest.mark.parametrize("place", ["world", "current"])
def test_a_view_is_beside_the_world_file_or_in_the_current_folder(tmp_path, place):
    world, current = tmp_path / "world", tmp_path / "current"
    for folder in (world, current):
        folder.mkdir()
    (current / "plain_view.py").write_text(PLAIN.format(place="current"), encoding="utf-8")
    if place == "world":
        (world / "plain_view.py").write_text(PLAIN.format(place="world"), encoding="utf-8")
    script = tmp_path / "script.py"  # `-c` would search the current folder anyway.
    script.write_text(VIEW, encoding="utf-8")
    words = [sys.executable, str(script), str(world)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=current)
    assert done.stdout.strip() == place
