"""Every reader names the damage of a record on standard error, and no check of one succeeds."""

import json
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

from minerva_analysis import diff, export, replay
from minerva_analysis.plot_command import plot_file
from minerva_analysis.record_summary import info_of, recover, recovered_name
from minerva_analysis.replays import read_replay
from minerva_bus.errors import DamagedRecordWarning, MisuseError, RecordError
from minerva_bus.log.record import Record
from minerva_bus.settings.world_settings import Overrides
from tests.log.recorded_runs import bytes_of, record_of
from tests.log.test_damaged import CHUNK, MESSAGE_INDEX, METADATA, flipped, parts, stopped
from tests.runtime.running import here

pytestmark = pytest.mark.filterwarnings("ignore::minerva_bus.errors.DamagedRecordWarning")

WHOLE = "lost: all from frame 0 on"


@pytest.fixture
def records(tmp_path, monkeypatch):
    """In the current folder: an intact record, one without its frames, and one that lacks some."""
    monkeypatch.chdir(tmp_path)
    data = empty = bytes_of("meadow")
    chunks = [at for at, _ in parts(data, CHUNK)]
    for at in chunks[1:]:
        empty = flipped(empty, at + 100)
    (tmp_path / "whole.mcap").write_bytes(data)
    (tmp_path / "empty.mcap").write_bytes(empty)
    (tmp_path / "holes.mcap").write_bytes(flipped(data, chunks[3] + 100))
    # The damaged end is not missed by a reader that compares all other frames.
    (tmp_path / "short.mcap").write_bytes(flipped(data, chunks[-1] + 100))
    return tmp_path


def minerva(*words):
    """The exit code, the output and the errors of a command in the current folder."""
    done = here(Path.cwd(), *words)
    return done.returncode, done.stdout, done.stderr


RECOMPUTE = ("replay", "{}", "meadow", "--recompute")


@pytest.mark.parametrize("name", ["empty", "holes", "short"])
@pytest.mark.parametrize(
    "words", [("info", "{}", "--check"), RECOMPUTE, ("diff", "{}", "{}")], ids=" ".join
)
def test_a_check_fails(records, name, words):
    code, out, err = minerva(*[word.format(f"{name}.mcap") for word in words])
    assert code == 1
    assert err.count(f"{name}.mcap is damaged: bytes ") == 1
    assert "all digests are right" not in out
    assert "the same:" not in out
    intact = [word.format("whole.mcap") for word in words]
    code, out, err = minerva(*intact)
    assert (code, err) == (0, "")


@pytest.mark.parametrize(
    "words",
    [
        ("info", "{}"),
        ("info", "{}", "--string"),
        ("replay", "{}", "--no-code"),
        ("export", "{}", "--collect", "foxes=count(AFox)", "--csv", "foxes.csv"),
        ("explain", "{}", "--agent", "meadow", "--attribute", "grass", "--no-code"),
        ("conversation", "{}", "--json"),
    ],
    ids=lambda words: words[0],
)
def test_a_reader_goes_on_and_names_the_damage(records, words):
    forced = ("--force",) if "--csv" in words else ()
    _, _, err = minerva(*[word.format("empty.mcap") for word in words])
    assert err.count("empty.mcap is damaged: bytes ") == 1
    assert WHOLE in err
    _, _, err = minerva(*[word.format("whole.mcap") for word in words], *forced)
    assert "damaged" not in err


def test_nothing_compared_is_not_the_same(records):
    code, out, _ = minerva("diff", "empty.mcap", "empty.mcap", "--json")
    assert (code, json.loads(out)["same"]) == (1, False)
    code, out, _ = minerva(*[word.format("empty.mcap") for word in RECOMPUTE])
    assert (code, out) == (1, "nothing was compared: there is no frame\n")


def test_a_wrong_digest_or_a_frame_that_is_missing_fails_a_check(records):
    code, _, err = minerva(*[word.format("holes.mcap") for word in RECOMPUTE])
    assert code == 1
    assert "frame 8 is not in the record" in err
    code, _, err = minerva("info", "none.mcap", "--check")
    assert code == 2
    assert err.startswith("minerva: none.mcap: No such file or directory")


def test_recovery_without_a_frame_fails_and_leaves_no_file(records):
    code, _, err = minerva("recover", "empty.mcap")
    assert code == 2
    assert "no frame in it is intact" in err
    assert WHOLE in err
    assert not (records / "empty.recovered.mcap").exists()
    code, out, err = minerva("recover", "holes.mcap")
    assert code == 1
    assert "holes.mcap is damaged: bytes " in err
    assert out.startswith("holes.recovered.mcap: ")
    code, _, err = minerva("info", "holes.recovered.mcap", "--check")
    assert (code, err) == (0, "")


def test_functions_warn(records):
    for read in (
        lambda: export("empty.mcap", collect={"foxes": "count(AFox)"}),
        lambda: replay("short.mcap", "meadow"),
        lambda: diff("short.mcap", "short.mcap"),
    ):
        with pytest.warns(DamagedRecordWarning, match=r"\.mcap is damaged: bytes .*; lost: "):
            result = read()
        assert not getattr(result, "same", False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert replay("whole.mcap", "meadow").same
        assert diff("whole.mcap", "whole.mcap").same


def test_a_wrong_summary_is_damage(records):
    data = (records / "whole.mcap").read_bytes()
    (records / "summary.mcap").write_bytes(flipped(data, len(data) - 60))
    code, _, err = minerva("info", "summary.mcap", "--check")
    assert code == 1
    assert "(its summary is wrong); lost: no frame" in err


def test_nothing_is_recovered_from_nothing(records):
    with (
        pytest.warns(DamagedRecordWarning),
        pytest.raises(RecordError, match="no frame in it is intact"),
    ):
        recover(records / "empty.mcap", records / "new.mcap")
    data = (records / "whole.mcap").read_bytes()
    second = [at for at, _ in parts(data, CHUNK)][1]
    for end in (second, second + 40):  # between two parts, and within the second chunk
        (records / "begun.mcap").write_bytes(data[:end])
        with pytest.raises(RecordError, match="no frame in it is intact"):
            recover(records / "begun.mcap", records / "new.mcap")
    assert not (records / "new.mcap").exists()


def test_commands_name_the_damage_that_took_all_frames(tmp_path):
    broken = bytes_of("meadow")
    for at, _ in parts(broken, CHUNK)[1:]:
        broken = flipped(broken, at + 100)
    with record_of(broken, tmp_path) as record:
        path = record.path
    with pytest.raises(
        MisuseError, match=r"there is no frame in it; .* is damaged: bytes .*; lost"
    ):
        read_replay(path, "meadow", Overrides())
    damage = "is damaged: bytes .*; lost: all from frame 0 on"
    pytest.importorskip("matplotlib")
    with pytest.warns(DamagedRecordWarning, match=damage):
        plot_file(path, None, (), "", "", bars=False, as_json=False)


@pytest.mark.parametrize("chunk", [2, 5, 10, 16])
def test_a_recovered_record_is_usable_like_any_other(chunk, tmp_path):
    path, new = tmp_path / "run.mcap", tmp_path / "new.mcap"
    data = stopped(path)
    at, _ = parts(data, CHUNK)[chunk]
    path.write_bytes(flipped(data, at + 80))
    done = recover(path, new)
    with Record(path) as old, Record(new) as record:
        expected = {frame.number: string for frame, string in old.strings(check=True)}
        strings = {frame.number: string for frame, string in record.strings(check=True)}
        assert strings == expected
        assert done.frames == len(strings) >= 20
        assert record.complete
        assert not record.losses().damage
        assert record.end()[0] == old.end()[0]
        for number in strings:
            assert record.string(number + 1) == strings[number]
        assert done.losses == old.losses()
        assert done.losses.lost or done.losses.open_from == 56


def test_a_recovery_names_wrong_indexes_between_chunks(tmp_path):
    path, new = tmp_path / "run.mcap", tmp_path / "new.mcap"
    data = bytes_of("meadow")
    (first, length), *_, (last, other) = parts(data, MESSAGE_INDEX)
    # A time in the first one, and the channel of the last one.
    path.write_bytes(flipped(flipped(data, first + 17), last + 9))
    done = recover(path, new)
    assert [(wrong.begin, wrong.end) for wrong in done.losses.damage] == [
        (first, first + length), (last, last + other)
    ]  # fmt: skip
    assert done.frames == 60
    assert f"damaged: {length + other:,} bytes in 2 places, bytes {first:,}" in done.lines()[1]
    assert done.lines()[2] == "lost: no frame"
    new.unlink()
    # No record at all: only the scan names it.
    path.write_bytes(flipped(data, last))
    assert recover(path, new).losses.damage[0].begin == last


REGIONS = {0x01: "header", METADATA: "metadata", CHUNK: "chunk", MESSAGE_INDEX: "index",
           0x0F: "end of the data", 0x03: "schema", 0x04: "channel", 0x08: "chunk's index",
           0x0B: "statistics", 0x0D: "metadata's index", 0x0E: "offset", 0x02: "footer"}  # fmt: skip


@pytest.mark.parametrize("finished", [True, False])
def test_damage_of_any_byte_is_no_success(finished, tmp_path):
    path, new = tmp_path / "run.mcap", tmp_path / "new.mcap"
    data = bytes_of("meadow", finished=finished)
    found = {"magic": (0, 8)} | ({"last magic": (len(data) - 8, 8)} if finished else {})
    for opcode, name in REGIONS.items():
        # The world is stored in the first two chunks, and the last one may be cut off.
        places = parts(data, opcode)
        found |= {name: places[len(places) // 2]} if places else {}
    assert len(found) == (len(REGIONS) + 2 if finished else 5)
    for name, (at, length) in found.items():
        middle = (9 + length) // 2 if length > 8 else 4
        for place in (0, 1, middle, length - 1):  # the opcode, the length, and the body
            path.write_bytes(flipped(data, at + place))
            with Record(path) as record:
                info = info_of(record, check=True)
            assert info.losses.damage, (name, place)
            assert not info.checked
        done = recover(path, new)
        assert done.losses == info.losses
        assert done.lines()[1].startswith("damaged: ")
        new.unlink()


def test_a_bit_that_leaves_all_parts_valid_is_found(tmp_path):
    path = tmp_path / "run.mcap"
    data = bytearray(bytes_of("meadow"))
    data[data.index(b"minerva-bus ") + 12] ^= 1  # The version, a digit.
    path.write_bytes(data)
    done = recover(path, tmp_path / "new.mcap")
    assert "the checksum of all data is wrong" in done.lines()[1]
    assert done.frames == 60


def test_recover_overwrites_nothing(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes_of("meadow", finished=False))
    assert recovered_name(path) == tmp_path / "run.recovered.mcap"
    with pytest.raises(MisuseError, match="is an input of this run"):
        recover(path, path)
    done = recover(path, recovered_name(path))
    assert done.lines()[-1] == "nothing was damaged"
    before = done.path.read_bytes()
    with pytest.raises(MisuseError, match="already exists"):
        recover(path, done.path)
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(RecordError, match="cut off before anything"):
        recover(path, tmp_path / "none.mcap")
    assert done.path.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.mcap", "run.recovered.mcap"]


def test_the_command_reports_losses(tmp_path):
    path = tmp_path / "run.mcap"
    data = bytes_of("meadow")
    at, _ = parts(data, CHUNK)[3]
    path.write_bytes(flipped(data, at + 100))
    words = [sys.executable, "-m", "minerva_bus", "recover", str(path), "--json"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1
    said = json.loads(done.stdout)
    assert said["record"] == str(tmp_path / "run.recovered.mcap")
    assert said["lost"][0][0] == 8
    assert said["damage"][0]["begin"] == at


def test_info_reports_losses(tmp_path):
    data = bytes_of("meadow")
    at, _ = parts(data, CHUNK)[3]
    with record_of(flipped(data, at + 100), tmp_path) as record:
        info = info_of(record)
    lines = "\n".join(info.lines())
    assert f"bytes {at:,} to " in lines
    assert "frames 8 to " in lines
    assert "minerva recover" in lines
    assert info.plain()["damage"][0]["begin"] == at
    assert info.frames == 60 - info.missing
    with record_of(data, tmp_path) as record:
        assert "damage" not in "\n".join(info_of(record).lines())
