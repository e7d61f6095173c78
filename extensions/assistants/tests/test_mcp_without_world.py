"""`minerva mcp NAME` starts without its world, and says so."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("mcp", reason="pip install 'minerva-bus[mcp]'")


def test_a_server_without_its_world_says_so_and_starts(tmp_path):
    """An assistant may start the server before the world."""
    words = [sys.executable, "-m", "minerva_bus", "mcp", "nothing"]
    env = {**os.environ, "MINERVA_RUNTIME_DIR": str(tmp_path)}
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, env=env)
    assert (done.returncode, done.stdout) == (0, "")
    problem = "warning: no world 'nothing' runs on this machine; running: none; the tools look for"
    assert done.stderr.startswith(problem)
