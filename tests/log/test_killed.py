"""Records of killed or truncated runs, or of full disks, keep all confirmed frames."""

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from minerva_bus.errors import RecordError
from minerva_bus.launch.past import read_resumed
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import Overrides
from tests.log.recorded_runs import ROOT
from tests.runtime.running import environment

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

MEADOW = ROOT / "worlds/minerva_worlds/meadow/meadow.toml"
CONFIRMING = """
import sys
from pathlib import Path
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.launch.run_outputs import recording
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.launch.world_files import read_world_file

_, world, path, flush, durable = sys.argv
how = {"flush": float(flush), "durable": durable == "yes"}
file = read_world_file(Path(world), Overrides(record=path, **how))
algorithm = FrameAlgorithm(file.world)
record = recording(file, algorithm, print)

def watch(told):
    if isinstance(told, s.FrameDone):
        record.frame_done(told)
        print(record._recorder.frames, flush=True)

runner = InProcessRunner(algorithm, [one.make_member() for one in file.processes], watch)
runner.start()
while True:
    runner.handle(s.Begin())
"""
"""A run that prints the number of confirmed frames in its record after each frame."""


def killed(folder, moment, flush, durable):
    """The record of a run killed at a random time, and its number of confirmed frames."""
    path = folder / "run.mcap"
    words = [sys.executable, "-c", CONFIRMING, MEADOW, path, str(flush), durable]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, text=True, env=environment(folder), cwd=ROOT
    ) as run:
        chance = random.Random(moment)
        said = [run.stdout.readline() for _ in range(chance.randrange(1, 60))]
        for _ in range(chance.randrange(20_000)):
            pass  # Delay into the middle of a frame.
        run.send_signal(signal.SIGKILL)
        said += run.stdout.read().splitlines(keepends=True)
    return path, max([0, *(int(line) for line in said if line.endswith("\n"))])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A record of the same run that was closed normally."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    words = ["run", MEADOW, "--in-process", "--rate", "0", "--frames", "90", "--record", path]
    subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", *words], check=True, capture_output=True,
        env=environment(path.parent), cwd=ROOT,
    )  # fmt: skip
    return path


def digests_of(record):
    """The digests of all frames, each of its string."""
    frames = [frame for frame, _ in record.strings(check=True)]
    assert [frame.number for frame in frames] == list(range(len(frames)))
    return [frame.digest for frame in frames]


def works(path, least, whole=None):
    """Check every use of a record; returns its number of frames."""
    with Record(path) as record:
        digests = digests_of(record)
        frames = len(digests)
        assert frames >= least
        if whole is not None:
            with Record(whole) as other:
                assert digests == digests_of(other)[:frames]
    resumed = read_resumed(path, "", Overrides(frames=frames + 5))
    assert resumed.world.past.frame == frames
    return frames


@pytest.mark.parametrize("moment", range(3))
def test_each_durable_frame_outlives_a_kill(moment, tmp_path, whole):
    path, confirmed = killed(tmp_path, moment, 2.0, "yes")
    assert confirmed >= 1
    assert works(path, confirmed, whole) <= confirmed + 2


@pytest.mark.parametrize("moment", range(3, 5))
def test_flushed_frames_survive_a_kill(moment, tmp_path, whole):
    path, confirmed = killed(tmp_path, moment, 0.0, "no")
    works(path, confirmed, whole)


def test_rarely_flushed_frames_may_be_lost(tmp_path):
    path, confirmed = killed(tmp_path, 7, 1000.0, "no")
    assert confirmed == 0
    assert works(path, 0) == 0


@pytest.mark.slow
@pytest.mark.parametrize("durable", ["yes", "no"])
@pytest.mark.parametrize("moment", range(100, 140))
def test_kills_at_very_many_moments(moment, durable, tmp_path, whole):
    path, confirmed = killed(tmp_path, moment, 0.01, durable)
    works(path, confirmed, whole)


def cut_every(path, folder, step):
    """Yields a record truncated at every multiple of `step` bytes."""
    data = path.read_bytes()
    cut = folder / "cut.mcap"
    for size in range(step, len(data), step):
        cut.write_bytes(data[:size])
        yield cut


def test_cut_off_at_every_thousandth_byte(tmp_path, whole):
    path, _ = killed(tmp_path, 11, 0.0, "yes")
    counts = []
    for cut in cut_every(path, tmp_path, 1000):
        try:
            with Record(cut) as record, Record(whole) as other:
                digests = digests_of(record)
                count = len(digests)
                assert digests == digests_of(other)[:count]
        except RecordError as error:
            assert not counts, error
            continue
        assert read_resumed(cut, "", Overrides(frames=1000)).world.past.frame == count
        counts.append(count)
    assert counts == sorted(counts)
    assert counts[-1] > 3


# --- full disks ---


def recorded_run(path, **process):
    """Run and record the meadow for 150 frames, in part; returns what it prints."""
    words = ["run", MEADOW, "--in-process", "--rate", "0", "--frames", "150", "--flush", "0"]
    # Python would store cut bytecode of what this process imports.
    env = {**environment(path.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", *words, "--record", path],
        capture_output=True, text=True, env=env, cwd=ROOT, **process,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    return done.stderr + done.stdout


def has_as_many_frames(path, said):
    """Whether a damaged record has as many frames as the summary of its run says."""
    with Record(path) as record:
        return f", {len(list(record.frames()))} of 150 frames (" in said


def test_a_file_that_may_not_grow_ends_the_record_and_not_the_world(tmp_path, whole):
    limit = 24_000
    path = tmp_path / "run.mcap"
    limited = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))  # noqa: E731
    said = recorded_run(path, preexec_fn=limited)
    [line] = [line for line in said.splitlines() if "the world continues without a record" in line]
    assert "File too large" in line
    confirmed = int(line.split("of which ")[1].split(" frames")[0])
    assert path.stat().st_size <= limit
    assert works(path, confirmed) >= 1
    assert has_as_many_frames(path, said)


@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("mount"), reason="mounting needs root")
def test_a_full_disk_ends_the_record_and_not_the_world(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=24k", "tmpfs", disk], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("no file systems can be mounted here")
    try:
        said = recorded_run(disk / "run.mcap")
        assert "No space left on device; the world continues without a record" in said
        confirmed = int(said.split("of which ")[1].split(" frames")[0])
        copy = Path(shutil.copy(disk / "run.mcap", tmp_path))
        assert works(copy, confirmed) >= 1
        assert has_as_many_frames(copy, said)
    finally:
        subprocess.run(["umount", disk], check=True)
