"""Ctrl-C at any time during the start of a command gives exit code 130 and no traceback."""

import subprocess
import sys

import pytest

from tests.log.recorded_runs import ROOT

INTERRUPTED = """
import _signal, sys

at, seen = int(sys.argv[1]), []


class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if seen or name == "minerva_bus.__main__":
            seen.append(name)
        if len(seen) == at + 1:
            seen.append("once")
            _signal.raise_signal(_signal.SIGINT)
        return None


sys.meta_path.insert(0, Interrupting())
for name in ("typing", "enum", "signal", "types"):
    sys.modules.pop(name, None)  # What starts Python may have read them, or not.
sys.argv = ["minerva", *sys.argv[2:]]
from minerva_bus.__main__ import main

main()
"""
"""A command that is interrupted at the n-th module search after that of its own package."""

MODULES = [*range(1, 9), *range(10, 50, 5), *range(50, 210, 20), *range(210, 690, 60)]


@pytest.mark.parametrize("begin", range(4))
def test_no_moment_of_the_start_shows_a_traceback(begin, tmp_path):
    world = ROOT / "worlds/minerva_worlds/meadow/meadow.toml"
    words = ["run", str(world), "--in-process", "--rate", "0", "--frames", "1"]
    interrupted = 0
    for at in MODULES[begin::4]:
        command = [sys.executable, "-c", INTERRUPTED, str(at), *words]
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
        assert "Traceback" not in done.stderr, (at, done.stderr)
        assert "ignored" not in done.stderr, (at, done.stderr)
        assert "KeyboardInterrupt" not in done.stderr, (at, done.stderr)
        assert done.returncode in (0, 130), (at, done.stderr)
        interrupted += done.returncode == 130
    assert interrupted >= 5
