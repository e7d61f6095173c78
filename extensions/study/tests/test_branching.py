"""`minerva branch` and `branch`: many futures of one frame of a record."""

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from minerva_bus import Agent, MinervaError, World, each, on, run
from minerva_bus.cli.main import app
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.settings.world_settings import Overrides
from minerva_study import branch
from minerva_study.branch_command import grid_of_branches
from minerva_study.branching import Branches

eDay = EventType("eDay")


def _growing(string, rate=1.0, **options):
    class Reed(Agent, symbol="AReed"):
        height: float = 0.0

        @on("eDay")
        def grow(self, day, moment):
            self.height += rate * moment.random.random()

    return World(string, agents=[Reed], services=[each(eDay)], name="reeds", options=options)


@pytest.fixture(scope="module")
def traffic(tmp_path_factory):
    """A recorded run: norms, a coupled device with a state of its own, options."""
    path = tmp_path_factory.mktemp("traffic") / "run.mcap"
    return run("traffic", frames=30, record=path, cars=8)


def test_a_branch_without_a_change_has_the_strings_of_the_record(traffic):
    table = branch(traffic, 20, {"norms": [True, False]}, seeds=2, workers=1, quiet=True)
    assert table.columns[:2] == ("norms", "seed")
    rows = list(zip(table["norms"].tolist(), table["seed"].tolist(), strict=True))
    assert rows == [(True, 1), (True, 2), (False, 1), (False, 2)]
    assert table["digest"][0] == traffic.digest
    assert len(set(table["digest"])) >= 2
    assert set(table["frames"]) == {30}
    # From the first frame and from the last one, too.
    for frame, frames in ((0, 30), (30, 33)):
        again = branch(traffic.record, frame, frames=frames, workers=1, quiet=True)
        assert again["digest"][0] == run("traffic", frames=frames, cars=8).digest


def test_a_branch_collects_from_its_frame_on(traffic):
    collect = {"fast": "mean(ACar.speed)"}
    table = branch(traffic, 20, seeds=[1], collect=collect, workers=1, quiet=True)
    whole = run("traffic", frames=30, cars=8, collect=collect).table()
    assert table["frame"].tolist() == list(range(20, 31))
    assert table["fast"].tolist() == whole["fast"].tolist()[20:]


def test_physics_continues_in_a_branch(tmp_path):
    done = run("robot", frames=12, record=tmp_path / "robot.mcap", laser_noise=0.01)
    table = branch(done, 8, seeds=2, workers=1, quiet=True)
    assert table["digest"][0] == done.digest != table["digest"][1]


def test_branches_run_in_an_executor(traffic):
    with ProcessPoolExecutor(1) as executor:
        given = {"executor": executor, "quiet": True, "collect": {"cars": "count(ACar)"}}
        there = branch(traffic, 24, {"norms": [True, False]}, **given)
        outcomes = branch(traffic, 24, executor=executor, quiet=True)
    here = branch(traffic, 24, {"norms": [True, False]}, workers=1, **{**given, "executor": None})
    assert list(there.rows()) == list(here.rows())
    assert outcomes["digest"].tolist() == [traffic.digest]


def test_a_running_world_branches_and_goes_on(tmp_path):
    world = _growing("AReed#a · AReed#b")
    with world.start(seed=3, record=tmp_path / "run.mcap") as live:
        live.step(6)
        now = branch(live, frames=9, seeds=2, workers=1, quiet=True)
        before = branch(live, 2, frames=9, workers=1, quiet=True)
        assert live.frame == 6
        live.step(3)
        assert now["seed"].tolist() == [3, 4]
        assert now["digest"][0] == before["digest"][0] == live.digest != now["digest"][1]
        with pytest.raises(MinervaError, match="frames 0 to 9, not 12"):
            branch(live, 12, frames=20)
        with pytest.raises(MinervaError, match="begin with frame 9 cannot end with frame 7"):
            branch(live, frames=7)
    with world.start() as live, pytest.raises(MinervaError, match="has no record on this machine"):
        branch(live, frames=20)


def test_the_record_is_read_once(tmp_path):
    path = tmp_path / "run.mcap"
    world = _growing("AReed#a · AReed#b")
    done = run(world, frames=9, record=path)
    branches = Branches.read(path, 5, world)
    path.unlink()
    runs = branches.sweep(grid_of_branches(branches, (), 3, None), Overrides())
    digests = [runs.world(runs.grid.overrides(c, runs.given)) for c in runs.grid]
    assert [file.world.seed for file in digests] == [0, 1, 2]
    assert all(file.world.past.frame == 5 for file in digests)
    assert done.frames == 9


def test_changed_code_is_reported(tmp_path):
    path = tmp_path / "run.mcap"
    run(_growing("AReed#a"), frames=9, record=path)
    for rate, continues in ((1.0, True), (2.0, False)):
        branches = Branches.read(path, 5, _growing("AReed#a", rate))
        table = branch(path, 5, world=branches.world, workers=1, quiet=True)
        runs = branches.sweep(grid_of_branches(branches, (), None, None))
        outcome = {"frames": 9, "digest": table["digest"][0]}
        row = _Row(outcome)
        assert branches.continues(row) is continues
        assert runs.identity["branch"] == 5


class _Row:
    def __init__(self, outcome):
        self.outcome = outcome


def test_the_command_reports_its_runs(traffic, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    words = ["branch", traffic.record, "--frame", "25", "--in-process", "--workers", "1"]
    done = CliRunner().invoke(
        app, [*words, "--set", "norms=true,false", "--runs", "5", "--tree", "tree.svg", "--json"]
    )
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert (answer["runs"], answer["continues"], answer["table"]) == (4, True, "run-25.csv")
    tree = (tmp_path / "tree.svg").read_text()
    assert tree.startswith("<?xml")
    # The same command has nothing left to run.
    again = CliRunner().invoke(app, [*words, "--set", "norms=true,false", "--seeds", "2"])
    assert again.exit_code == 0, again.output
    assert f"norms=true, seed=1: as recorded, digest {traffic.digest}" in again.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"frame": 31}, "runs can branch at frames 0 to 30, not 31"),
        ({"frame": 30}, "this run is over after 30 frames"),
        ({"grid": {"carz": [1]}}, "carz"),
        ({"grid": {"cars": 3}}, "expected a list of values"),
        ({"seeds": 0}, "seeds=0: expected at least one seed"),
        ({"world": "robots"}, "no option --cars"),
    ],
)
def test_wrong_arguments_are_explained(traffic, arguments, says):
    with pytest.raises(MinervaError) as caught:
        branch(traffic.record, **{"frame": 20, "quiet": True, **arguments})
    assert says in str(caught.value)


def test_limits_of_runs(traffic):
    branches = Branches.read(traffic.record, 20)
    both = ("norms=true,false",)
    assert len(grid_of_branches(branches, both, None, 100)) == 100
    assert len(grid_of_branches(branches, both, 5, 100)) == 10
    for settings, seeds, runs in ((both, 5, 9), (both, None, 1), (("seed=1,2",), 3, None)):
        with pytest.raises(MinervaError, match=r"--runs|--seeds"):
            grid_of_branches(branches, settings, seeds, runs)
    with pytest.raises(MinervaError, match="it is the record of another world"):
        branch(traffic.record, 20, world=_growing("AReed#a", cars=8))


def test_a_run_without_a_record_is_repeated(tmp_path):
    pytest.importorskip("mcap")
    world = _growing("AReed#a · AReed#b")
    # Its own seed and settings, and a table that a repetition must not replace.
    done = run(world, frames=9, seed=4, collect={"n": "count(AReed)"}, into=tmp_path / "n.csv")
    (tmp_path / "n.csv").write_text("kept")
    table = branch(done, 6, seeds=2, workers=1, quiet=True)
    assert table["seed"].tolist() == [4, 5]
    assert table["digest"][0] == done.digest != table["digest"][1]
    assert (tmp_path / "n.csv").read_text() == "kept"
    with pytest.raises(MinervaError, match="cannot be repeated"):
        branch(replace(done, digest="0" * 32), 6, quiet=True)
    with pytest.raises(MinervaError, match="has no record"):
        branch(replace(done, world=None), 6)
