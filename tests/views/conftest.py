"""Painters release their contexts at the end of a test."""

import sys

import pytest


@pytest.fixture(autouse=True)
def closed():
    yield
    world = sys.modules.get("opengl_world")
    while world is not None and world.PAINTERS:
        world.PAINTERS.pop().close()
