"""`minerva info`."""

import io
import json

import pytest
import typer
from arbitrary_records import files

from minerva_analysis.info_command import show_info
from minerva_analysis.record_summary import info_of, moment_of
from minerva_bus.api.running import run
from minerva_bus.grammar.events import single
from minerva_bus.log.entries import encode_frame
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.world.operator import PersonOperation
from tests.api.frogs import race
from tests.log.recorded_runs import bytes_of, description, happened, strings_of

mcap = pytest.importorskip("mcap")


def test_info_describes_the_record(tmp_path, capsys):
    path, _ = files(tmp_path, bytes_of("meadow"))
    show_info(path, check=True, as_json=True)
    info = json.loads(capsys.readouterr().out)
    _, frames = happened("meadow")
    events = [event.type for record, _ in frames for event in single(record.events)]
    assert info["world"] == "meadow"
    assert info["seed"] == 7
    assert info["complete"] is info["checked"] is True
    assert (info["frames"], info["missing"]) == (60, 0)
    assert info["seconds"] == pytest.approx(2.4)
    assert info["events"] == {name: events.count(name) for name in sorted(set(events))}
    assert info["digest"] == frames[-1][0].digest.hex()
    assert info["first_agents"] == {"AFox": 3, "AMeadow": 1, "ARabbit": 6}
    rabbits = sum(node.symbol == "ARabbit" for node in strings_of("meadow")[-1])
    assert info["last_agents"]["ARabbit"] == rabbits
    assert info["log_lines"] == 60
    assert info["timings"] == {"evolve": pytest.approx(0.001)}
    assert info["options"] == {"start": "1"}


def test_info_for_people(tmp_path, capsys):
    path, _ = files(tmp_path, bytes_of("flock", finished=False))
    show_info(path, check=False, as_json=False)
    said = capsys.readouterr().out
    assert "flock, seed 1" in said
    assert "cut off" in said
    assert "ABird 80 → 80, AHawk 1 → 1" in said


def test_events_that_agents_send_in_the_last_frame_count(tmp_path):
    path = tmp_path / "race.mcap"
    done = run(race("anna"), record=path, frames=3)
    with Record(path) as record:
        assert info_of(record).events == done.events
        assert [event.type for event in moment_of(record, None).events] == ["eCross"]


def test_info_lists_what_people_did(tmp_path, capsys):
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(happened("meadow")[0]))
    for frame, value in ((3, "2"), (9, "5")):
        writer.noted(PersonOperation(frame, "step", value, "anna"), 0.1)
    writer.noted(PersonOperation(12, "pause"), 0.2)
    writer.finish()
    path, _ = files(tmp_path, stream.getvalue())
    show_info(path, check=False, as_json=True)
    steps = json.loads(capsys.readouterr().out)["operations"]
    assert steps[1] == {"frame": 9, "command": "step", "value": "5", "person": "anna"}
    show_info(path, check=False, as_json=False)
    assert "operated    step by anna ×2, pause by people" in capsys.readouterr().out


def test_info_checks(tmp_path, monkeypatch, capsys):
    file, frames = happened("meadow")
    stream = io.BytesIO()
    writer = RecordWriter(stream, description(file))
    encoded = lambda number, events, edit, _: encode_frame(number, events, edit, bytes(16))  # noqa: E731
    monkeypatch.setattr("minerva_bus.log.record_writer.encode_frame", encoded)
    writer.frame(*frames[0], 0.0, {})
    writer.finish()
    path, _ = files(tmp_path, stream.getvalue())
    with pytest.raises(typer.Exit) as ended:
        show_info(path, check=True, as_json=False)
    assert ended.value.exit_code == 1
    assert "the digest of the string after frame 0 is" in capsys.readouterr().err
