"""Common fixtures of tests with a listening world; each module defines its own `world`."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("minerva_certificates")  # It issues the certificates.
sys.path.append(str(Path(__file__).parent))
from secured import AuthorityFolder, secured_endpoint


@pytest.fixture(scope="module")
def door(world):
    """The endpoint for remote members."""
    return secured_endpoint(world)


@pytest.fixture(scope="module")
def keys(world):
    """The folder of its keys."""
    return AuthorityFolder(world.folder / "keys")
