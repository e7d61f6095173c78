"""What tests of a world with a door have in common; `world` is each module's own."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from secured import KeyFolder, secured_endpoint


@pytest.fixture(scope="module")
def door(world):
    """Where others come in."""
    return secured_endpoint(world)


@pytest.fixture(scope="module")
def keys(world):
    """The folder of its keys."""
    return KeyFolder(world.folder / "keys")
