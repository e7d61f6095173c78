"""`minerva replay` on the bus supports the commands for running worlds."""

import json

import pytest

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.run_outputs import recording
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from tests.runtime.running import Run, World, eventually, here, minerva, summary, write_world

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

SCREEN = "yard:Screen:said=true"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The path of a recorded world of 60 frames, and the run's summary."""
    folder = tmp_path_factory.mktemp("recorded")
    path = write_world(folder, frames=60)
    done = here(folder, "run", path, "--in-process", "--record", "run.mcap", "--json")
    return path, summary(done)


class Replayed(World):
    """A `minerva replay` process."""

    def __init__(self, path, *words):
        Run.__init__(self, path.parent, "replay", "run.mcap", *words)
        self.path, self.name, self.pids, self.frame = path, f"{path.stem}-replay", {}, 0


def test_it_ends_with_the_string_that_the_run_has_left(recorded):
    path, whole = recorded
    done = minerva(path.parent, "replay", "run.mcap", "--speed", 0, "--view", SCREEN, "--json")
    again = summary(done)
    assert (again["digest"], again["frames"]) == (whole["digest"], 60)
    assert again["ended"] == "the record is over"
    assert "frame 60: " in done.stderr


def test_without_a_view_it_plays_to_its_end_too(recorded):
    path, whole = recorded
    done = minerva(path.parent, "replay", "run.mcap", "--speed", 0, "--from", 50, "--json")
    assert summary(done)["digest"] == whole["digest"]


def test_it_is_paused_stepped_wound_and_looked_at(recorded):
    path, _ = recorded
    folder = path.parent
    with Replayed(path, "--speed", 0.01, "--view", SCREEN) as replay:
        replay.endpoint()
        eventually(lambda: "screen" in replay.members(), "its view takes part")

        def told(*words):
            done = here(folder, *words)
            assert done.returncode == 0, done.stderr
            return done.stdout

        told("pause")
        assert told("seek", 40).endswith("continues from frame 40\n")
        replay.says("frame 40: ")
        assert told("step", 3).endswith("paused before frame 43\n")
        replay.says("frame 42: ")
        told("seek", 7)
        replay.says("frame 7: ")
        status = json.loads(told("list", "--json"))
        assert (status["frame"], status["paused"]) == (7, True)
        for words, problem in (
            (("seek", 61), "the record ends before frame 60, not 61"),
            (("pub", "eWish", "x=1", "name=n"), "recorded frames cannot change"),
        ):
            done = here(folder, *words)
            assert (done.returncode, problem in done.stderr) == (2, True), done.stderr
        late = Run(folder, "attach", SCREEN.partition(":said")[0], "--said", "true")
        with late:
            late_says = lambda: any("frame 7: " in line for line in late.output)  # noqa: E731
            eventually(late_says, f"who joins sees where it rests\n{late.text}")
            told("rate", 0)
            told("resume")
            assert replay.ends() == 0
            assert late.ends() == 0
        replay.gone()


def test_seeking_is_for_replays(tmp_path):
    with World(write_world(tmp_path, frames=0, rate=20)) as world:
        world.runs("steps", "walkers")
        done = here(tmp_path, "seek", 3)
        assert done.returncode == 2
        assert "this is not a replay" in done.stderr


def test_its_frames_are_reckoned_again(recorded):
    path, _ = recorded
    done = here(path.parent, "replay", "run.mcap", "--recompute")
    assert (done.returncode, done.stdout) == (
        0,
        "the same: all 60 recomputed frames match the record\n",
    )


def test_other_code_gives_other_frames(recorded, tmp_path):
    path, _ = recorded
    folder = path.parent
    other = tmp_path / "other.toml"
    other.write_text(path.read_text().replace('"yard:Walker"', '"lame:Lame"'))
    (tmp_path / "yard.py").write_text((folder / "yard.py").read_text())
    (tmp_path / "lame.py").write_text(
        "from yard import Walker\nfrom minerva_bus import on\n"
        "class Lame(Walker, symbol='AWalker'):\n"
        "    @on('eStep')\n    def walk(self, step, moment):\n"
        "        if moment.number < 4:\n            return super().walk(step, moment)\n"
    )
    done = minerva(folder, "replay", "run.mcap", other, "--recompute")
    assert done.returncode == 1, done.stderr
    assert "frame 4 is the first that differs" in done.stdout
    assert "in the record," in done.stdout


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("none.mcap",), "No such file"),
        (("run.mcap", "--from", 60), "it has frames 0 to 59, not 60"),
        (("run.mcap", "--from", 60, "--no-code"), "it has frames 0 to 59, not 60"),
        (("run.mcap", "--speed", -1), "--speed must be a number from 0, not -1"),
        (("run.mcap", "nothing.toml"), "there is no world file nothing.toml"),
    ],
)
def test_an_unplayable_record_is_rejected_in_one_line(recorded, words, problem):
    done = here(recorded[0].parent, "replay", *words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_record_without_frames_is_refused(recorded):
    path, _ = recorded
    file = read_world_file(path, Overrides(record=str(path.parent / "empty.mcap")))
    recording(file, FrameAlgorithm(file.world), print).close()
    done = here(path.parent, "replay", "empty.mcap")
    assert (done.returncode, "there is no frame in it" in done.stderr) == (2, True)


@pytest.mark.parametrize("option", [("--from", 5), ("--view", "svg"), ("--speed", 2)])
def test_options_that_would_be_ignored_are_rejected(tmp_path, option):
    done = here(tmp_path, "replay", "run.mcap", "--recompute", *option)
    assert done.returncode == 2
    assert f"{option[0]} cannot be combined with --recompute" in done.stderr
