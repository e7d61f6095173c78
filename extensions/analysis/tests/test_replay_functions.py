"""`replay` and `replay_views` give what the command gives."""

from pathlib import Path

import pytest

from minerva_analysis import replay, replay_views
from minerva_bus import Agent, World, each, on, record, run
from minerva_bus.errors import MisuseError, WorldFileError
from tests.api.frogs import eTick, pond
from tests.runtime.running import minerva, summary

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

PAPER = "svg:path={},every=5"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the world file of a pond and its record, of 10 frames."""
    made = tmp_path_factory.mktemp("records")
    pond().save(made / "pond.toml")
    record(made / "pond.toml", made / "run.mcap", frames=10, seed=5)
    return made


def test_a_changed_agent_is_found_by_a_replay(tmp_path):
    path = tmp_path / "a.mcap"

    class Frog(Agent, symbol="AHopper"):
        x: int = 0
        step = 1

        @on("eTick")
        def live(self, tick, moment):
            self.x += Frog.step

    world = World("AHopper#a", agents=[Frog], services=[each(eTick)])
    record(world, path, frames=5)
    assert replay(path, world).same
    Frog.step = 2
    result = replay(path, world)
    assert (result.same, result.frame) == (False, 0)


def test_a_record_is_shown_in_a_view_as_by_the_command(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    own, other = tmp_path / "own.svg", tmp_path / "other.svg"
    words = "--view", PAPER.format(other), "--speed", 0, "--json"
    # Its processes are forked, which must not happen after this process has used Zenoh.
    command = summary(minerva(folder, "replay", folder / "run.mcap", *words))
    done = replay_views(folder / "run.mcap", PAPER.format(own), speed=0, quiet=True)
    assert (done.frames, done.ended) == (10, "the record is over")
    assert (done.digest, done.ended) == (command["digest"], command["ended"])
    assert done.scene == run(folder / "pond.toml", frames=10, seed=5).scene
    assert own.read_text() == other.read_text()


@pytest.mark.parametrize(("views", "settings", "error", "problem"), [
    ("svgg", {}, WorldFileError, "no view 'svgg'"),
    ("svg", {"begin": 10}, MisuseError, "it has frames 0 to 9, not 10"),
    ("svg", {"speed": -1}, MisuseError, "must be a number from 0"),
])  # fmt: skip
def test_a_wrong_view_or_frame_is_reported_before_processes_start(
    folder, views, settings, error, problem
):
    with pytest.raises(error, match=problem):
        replay_views(folder / "run.mcap", views, **settings)
