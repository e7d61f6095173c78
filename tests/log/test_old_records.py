"""Records of earlier versions are readable without the world's code.

    python -m tests.log.test_old_records

writes a record of the current version; those of earlier versions remain.
"""

import json
from pathlib import Path

import pytest

from minerva_bus.cli.main import main
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.log.entries import FORMAT
from minerva_bus.log.record import Record
from tests.log.recorded_runs import bytes_of

mcap = pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

CORPUS = Path(__file__).with_name("corpus")
RECORDS = sorted(CORPUS.glob("*.mcap"))


def contents(path):
    """The digest of each frame's string and its events, as the reader returns them."""
    with Record(path) as record:
        return [
            {"digest": frame.digest.hex(), "events": [str(event) for event in frame.events]}
            for frame, _ in record.strings(check=True)
        ]


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_every_frame_of_a_record_of_an_earlier_version_is_read(path):
    assert contents(path) == json.loads(
        path.with_name(f"{path.name}.json").read_text(encoding="utf-8")
    )


@pytest.mark.parametrize("command", [["info"], ["replay", "--no-code"]])
@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_commands_read_a_record_of_an_earlier_version(path, command, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["minerva", *command, str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "meadow" in capsys.readouterr().out


def test_there_is_a_record_of_this_version():
    assert CORPUS / f"format-{FORMAT}-protocol-{PROTOCOL_VERSION}.mcap" in RECORDS


if __name__ == "__main__":
    path = CORPUS / f"format-{FORMAT}-protocol-{PROTOCOL_VERSION}.mcap"
    path.write_bytes(bytes_of("meadow"))
    path.with_name(f"{path.name}.json").write_text(json.dumps(contents(path), indent=0) + "\n")
