"""Painters let go of their contexts when a test is over."""

import sys

import pytest


@pytest.fixture(autouse=True)
def closed():
    yield
    world = sys.modules.get("opengl_world")
    while world is not None and world.PAINTERS:
        world.PAINTERS.pop().close()
