"""Four robots give the same strings in any layout.

The layouts have different numbers of processes and use TCP, Unix sockets or a single process; others
recompute the record, or resume it in another layout.
"""

import tempfile
from pathlib import Path

import pytest

from tests.runtime.running import here, minerva, summary

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

NOISE = ("--laser-noise", "0.02", "--drive-noise", "0.05", "--turn-noise", "1.0")
ROBOTS = ("run", "robot", "--robots", 4, "--until", "", *NOISE)
LAYOUTS = [(count, kind) for count in (1, 2, 4, 8) for kind in ("tcp", "unix")]


def spread(count, kind, folder):
    """The options of a run on the bus with `count` robot processes."""
    listen = "tcp/127.0.0.1:0" if kind == "tcp" else f"unixsock-stream/{folder}/{count}.sock"
    return "--set", f"robots.processes={count}", "--listen", listen, "--name", f"r{count}-{kind}"


def ran(folder, *words):
    """Digest and number of frames of a run."""
    done = summary(minerva(folder, *words, "--json"))
    return done["digest"], done["frames"]


class Layouts:
    """A reference run in one process, and runs of the same world in other layouts."""

    def __init__(self, frames, folder):
        self.frames = frames
        self.folder = Path(folder)
        words = (*ROBOTS, "--frames", frames, "--in-process", "--record", "whole.mcap")
        self.whole = ran(self.folder, *words)
        assert self.whole[1] == frames

    def check(self, count, kind):
        """Check that the record of another layout is equal."""
        name = f"{count}-{kind}.mcap"
        words = (*ROBOTS, *spread(count, kind, self.folder), "--record", name)
        assert ran(self.folder, *words, "--frames", self.frames) == self.whole
        done = here(self.folder, "diff", "whole.mcap", name)
        assert done.returncode == 0, done.stdout

    def check_reckoned_again(self):
        """Check that λ reproduces all frames of the record."""
        done = here(self.folder, "replay", "whole.mcap", "--recompute")
        assert done.returncode == 0, done.stdout

    def check_resumed(self, half, count, kind):
        """Check that a run which is stopped half-way and resumed in another layout is equal."""
        words = ("--frames", half, "--record", "cut.mcap", *spread(2, "tcp", self.folder))
        assert ran(self.folder, *ROBOTS, *words)[1] == half
        words = ("--resume", "cut.mcap", "--frames", self.frames, "--record", "on.mcap")
        words += spread(count, kind, self.folder)
        assert ran(self.folder, "run", "robot", *words) == self.whole
        done = here(self.folder, "diff", "whole.mcap", "on.mcap")
        assert done.returncode == 0, done.stdout


@pytest.fixture(scope="module")
def few():
    with tempfile.TemporaryDirectory(prefix="mnv") as folder:  # The path of a socket must be short.
        yield Layouts(40, folder)


@pytest.mark.parametrize(("count", "kind"), [(1, "unix"), (8, "tcp")])
def test_few_frames_in_another_layout(few, count, kind):
    few.check(count, kind)


def test_few_frames_reckoned_again(few):
    few.check_reckoned_again()


def test_few_frames_resumed_in_another_layout(few):
    few.check_resumed(20, 4, "unix")


@pytest.fixture(scope="module")
def record():
    with tempfile.TemporaryDirectory(prefix="mnv") as folder:
        yield Layouts(1000, folder)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("count", "kind"), LAYOUTS)
def test_a_thousand_frames_in_every_layout(record, count, kind):
    record.check(count, kind)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_thousand_frames_reckoned_again_and_resumed(record):
    record.check_reckoned_again()
    record.check_resumed(500, 8, "unix")
