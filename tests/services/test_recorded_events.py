"""The service `recorded`: the actions of an episode drive a world."""

from contextlib import suppress

import pytest
from rover_yard import Rover, record_yard, yard

from minerva_bus import MinervaError, World, run, service
from minerva_services.input.recorded import RecordedEvents


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The run of the yard, and its record."""
    pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
    path = tmp_path_factory.mktemp("yard") / "yard.mcap"
    return record_yard(path), path


def played(record, events="eSteer", string="ARover#r1 · ARover#r2<x=5>", **options):
    driver = service(RecordedEvents, file=str(record), events=events, **options)
    return World(string, agents=[Rover], services=[driver], name="yard", frames=5)


def test_an_episode_drives_the_same_world_to_the_same_string(recorded):
    done, path = recorded
    # Another seed: the events are those of the record, not new ones.
    assert run(played(path), seed=99).digest == done.digest
    assert run(yard(), seed=99).digest != done.digest


def test_it_drives_another_world_and_begins_at_any_frame(recorded):
    done, path = recorded
    whole = {node.id: node.state["x"] for node in done.scene}
    first = run(yard(), frames=3)
    later = run(played(path, string="ARover#r1<x=7> · ARover#r3", begin=3))
    state = {node.id: node.state["x"] for node in later.scene}
    before = {node.id: node.state["x"] for node in first.scene}
    assert state["r1"] - 7 == pytest.approx(whole["r1"] - before["r1"])
    assert state["r3"] == 0.0
    assert later.events["eSteer"] == 4


def test_the_damage_of_an_episode_is_reported(recorded, tmp_path, capfd):
    data = bytearray(recorded[1].read_bytes())
    # In the last chunk, which is followed by the index.
    at = data.rindex(b"\x28\xb5\x2f\xfd")
    data[at + 8 : at + 12] = b"\xff" * 4
    (tmp_path / "torn.mcap").write_bytes(data)
    with suppress(MinervaError):
        run(played(tmp_path / "torn.mcap"))
    assert "torn.mcap is damaged: bytes " in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"events": "eSteeer"}, "has no event type eSteeer; did you mean 'eSteer'"),
        ({"events": ""}, "events is empty"),
        ({"begin": -1}, "expected a frame from 0"),
    ],
)
def test_mistakes_are_reported(recorded, arguments, says):
    with pytest.raises(MinervaError, match=says):
        run(played(recorded[1], **arguments))


def test_a_record_without_such_events_is_refused(recorded, tmp_path):
    path = tmp_path / "still.mcap"
    run(World("ARover#r1", agents=[Rover], name="yard", frames=2), record=path)
    with pytest.raises(MinervaError, match=r"has no eSteer to play; it has none"):
        run(played(path))
    with pytest.raises(MinervaError, match=r"no\.mcap"):
        run(played(tmp_path / "no.mcap"))
