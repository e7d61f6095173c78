"""Every reader names the damage of a record on standard error, and no check of one succeeds."""

import json
import warnings
from pathlib import Path

import pytest

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

from minerva_analysis import diff, export
from minerva_analysis.record_summary import recover
from minerva_bus.api.records import replay
from minerva_bus.errors import DamagedRecordWarning, RecordError
from tests.log.recorded_runs import bytes_of
from tests.log.test_damaged import CHUNK, flipped, parts
from tests.runtime.running import here

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
    assert (code, err) == (2, "minerva: none.mcap: No such file or directory\n")


def test_recovery_without_a_frame_fails_and_leaves_no_file(records):
    code, _, err = minerva("recover", "empty.mcap")
    assert code == 2
    assert "no frame in it is intact" in err
    assert WHOLE in err
    assert not (records / "empty.recovered.mcap").exists()
    code, out, err = minerva("recover", "holes.mcap")
    assert code == 0
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
