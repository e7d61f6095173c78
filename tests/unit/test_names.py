"""The names of the package are imported on first access."""

import subprocess
import sys

import pytest

import minerva_bus


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
