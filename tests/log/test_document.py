"""The pages on records: the example runs, and the description of the format holds."""

import re
from pathlib import Path

import pytest

from minerva_bus.log import channels as c
from minerva_bus.log.chunks import CHUNK_FLOOR, FEWEST_MESSAGES, FLOOR, RATIO, Chunks
from minerva_bus.log.record_writer import KEY_AFTER
from minerva_bus.log.recorder import PATIENCE, WAITING
from minerva_bus.wire.plain import ON_DISK, unpack
from tests.log.recorded_runs import bytes_of, happened, strings_of

mcap = pytest.importorskip("mcap")

DOCS = Path(__file__).parents[2] / "docs"
DOCUMENT = "\n".join(
    (DOCS / name).read_text(encoding="utf-8")
    for name in ("records.md", "reference/record-format.md")
)


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    example, cursor = re.findall(r"^```python\n(.*?)^```$", DOCUMENT, re.M | re.S)
    (tmp_path / "run.mcap").write_bytes(bytes_of("meadow"))
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "records.md", "exec"), {})
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "meadow 7 complete"
    record, _ = happened("meadow")[1][2]
    assert said[3] == f"2 {len(record.events)} events, {record.digest.hex()}"
    assert said[61] == str(strings_of("meadow")[10])
    exec(compile(cursor, "records.md", "exec"), {})
    state, ahead, after = capsys.readouterr().out.splitlines()
    assert state.startswith(strings_of("meadow")[10].digest.hex())
    assert ahead.startswith("10 ")
    assert after == strings_of("meadow")[11].digest.hex()


def test_the_messages_are_as_written(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes_of("meadow"))
    chunks = Chunks(path)
    (_, world), (_, again) = chunks.messages((c.WORLD,))
    name, version, plain = unpack(world.data)
    (listed,) = re.findall(r'\["world", 3, \{(.*?)\}\]', DOCUMENT)
    assert (name, version) == ("world", 3)
    assert unpack(again.data) == [name, version, plain | {"string": None}]
    assert list(plain) == listed.split(", ")
    for topic, count in ((c.FRAME, 5), (c.KEYFRAME, 5), (c.CHECKPOINT, 8)):
        _, first = next(chunks.messages((topic,)))
        assert len(unpack(first.data)) == count
    chunks.close()


def test_the_figures_are_those_of_the_code():
    for said in (
        f"up to {WAITING} frames",
        f"become {KEY_AFTER} times as long",
        f"at most {CHUNK_FLOOR >> 20} MiB, all chunks of a file to {FLOOR >> 20} MiB",
        f"{RATIO:,} bytes more for each packed byte",
        f"at most {FEWEST_MESSAGES} messages",
        f"{ON_DISK.items // 1_000_000} million items",
    ):
        assert said in " ".join(DOCUMENT.split())
    assert PATIENCE == 5.0
    assert "for five seconds, frames are dropped" in " ".join(DOCUMENT.split())
