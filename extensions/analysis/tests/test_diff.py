"""`minerva diff`."""

import io
import json
from dataclasses import replace

import pytest
from arbitrary_records import files, written

from minerva_analysis import diff as compared
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.log.record_writer import RecordWriter
from tests.log.recorded_runs import bytes_of, description, happened, strings_of

mcap = pytest.importorskip("mcap")


def diff(folder, a, b):
    difference = compared(*files(folder, a, b))
    return int(not difference.same), json.loads(json.dumps(difference.plain()))


def test_two_records_of_one_run_are_the_same(tmp_path):
    code, difference = diff(tmp_path, bytes_of("meadow", 8), bytes_of("meadow", 3))
    assert (code, difference["same"], difference["frames"]) == (0, True, 60)
    assert difference["frame"] is None
    assert difference["before"] == []


def test_another_seed(tmp_path):
    code, difference = diff(tmp_path, bytes_of("meadow"), bytes_of("meadow", seed=8))
    assert code == 1
    assert difference["before"] == ["seed 7 in A, 8 in B"]
    strings = strings_of("meadow"), [string for _, string in happened("meadow", 8)[1]]
    first = next(n for n in range(60) if strings[0][n + 1] != strings[1][n])
    assert difference["frame"] == first
    assert difference["changes"]


def changed_in(string, agent, **values):
    def one(node):
        if not isinstance(node, AgentNode) or node.id != agent:
            return node
        state = {**node.state, **values}
        return AgentNode(node.symbol, node.id, tuple(state), tuple(state.values()), node.scope)

    return Scene(tuple(one(node) for node in string.nodes))


def test_an_attribute_and_receivers(tmp_path):
    frames = list(happened("meadow")[1])
    record, string = frames[5]
    frames[5] = record, changed_in(string, "f2", energy=3.25)
    code, difference = diff(tmp_path, bytes_of("meadow"), written(frames))
    assert (code, difference["frame"], difference["frames"]) == (1, 5, 5)
    [change] = difference["changes"]
    energy = next(node.state["energy"] for node in string.nodes if getattr(node, "id", "") == "f2")
    assert (change["agent"], change["attribute"]) == ("AFox#f2", "energy")
    assert (float(change["a"]), change["b"]) == (energy, "3.25")
    assert "eStep" in change["events"]


def test_an_event_that_only_one_has(tmp_path):
    frames = list(happened("meadow")[1])
    record, string = frames[7]
    frames[7] = replace(record, events=record.events[:-1]), string
    # What an observer asks for is no difference.
    frames[6] = (
        replace(frames[6][0], events=(*frames[6][0].events, Event("ePicture"))),
        frames[6][1],
    )
    code, difference = diff(tmp_path, bytes_of("meadow"), written(frames))
    assert (code, difference["frame"]) == (1, 7)
    assert difference["events"] == {"a": [str(record.events[-1])], "b": []}
    assert difference["changes"] == []


def test_one_that_goes_on_and_one_with_a_hole(tmp_path):
    frames = happened("meadow")[1]
    code, difference = diff(tmp_path, written(frames[:20]), bytes_of("meadow"))
    assert (code, difference["same"], difference["frame"]) == (1, False, None)
    assert difference["ended"] == "the same for 20 frames, all frames of A; B continues"
    code, difference = diff(tmp_path, bytes_of("meadow"), written([*frames[:9], *frames[10:]]))
    assert (code, difference["frame"]) == (1, 9)
    assert difference["before"] == ["frame 9 is missing in B"]


def test_an_agent_that_is_not_there_and_what_is_no_agent(tmp_path):
    frames = list(happened("meadow")[1])
    record, string = frames[3]
    kept = [node for node in string.nodes if getattr(node, "id", "") != "r1"][:-1]
    frames[3] = record, Scene(tuple(kept))
    _, difference = diff(tmp_path, bytes_of("meadow"), written(frames))
    said = {change["agent"]: (change["a"], change["b"]) for change in difference["changes"]}
    assert said["ARabbit#r1"] == ("is there", "is not there")
    assert "outside of agents" in said


def test_for_people(tmp_path):
    frames = list(happened("robot")[1])
    paths = files(tmp_path, bytes_of("robot"), bytes_of("robot"))
    assert compared(*paths).lines() == ["the same: 12 frames"]
    grid = next(node.state["grid"] for node in frames[4][1].nodes if node.symbol == "ARobot").copy()
    grid[5, 7] += 1
    file, _ = happened("robot")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    for record, string in frames:
        now = changed_in(string, "r1", grid=grid) if record.frame == 4 else string
        writer.frame(replace(record, digest=now.digest), now, 0.0, {})
    writer.finish()
    said = compared(*files(tmp_path, bytes_of("robot"), stream.getvalue())).lines()
    assert said[0] == "frame 4 is the first that differs"
    assert said[1].startswith("  ARobot#r1, received eLaser<")
    assert said[2] == f"    grid[5, 7]: {grid[5, 7] - 1} in A, {grid[5, 7]} in B"
