"""MCAP: what the reader of records reads in the files, beside their description in JSON.

A record is an MCAP file of the profile `minerva` with all messages in chunks, so the files of the
suite are refused as records. Its parts are judged: the scanner, the chunks and the summary.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minerva_bus.errors import RecordError
from minerva_bus.log.chunks import (
    MESSAGE,
    Chunks,
    channels_in,
    read_summary,
    scan,
    split,
)
from tools.acceptance.suite import Result, Suite, judged, whole_files

PADDED = "records with bytes after their fields, which no writer of ours makes, are damage"
UNCHUNKED = "messages outside of chunks, which no record of a run has, are damage"


@dataclass(frozen=True)
class Described:
    """The description of a file: the fields of its records by type, and its features."""

    records: Mapping[str, Sequence[Mapping[str, Any]]]
    features: frozenset[str]

    @classmethod
    def read(cls, path: Path) -> Described:
        """The description beside an MCAP file."""
        plain = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        records: dict[str, list[Mapping[str, Any]]] = {}
        for record in plain["records"]:
            records.setdefault(record["type"], []).append(dict(record["fields"]))
        return cls(records, frozenset(plain["meta"]["variant"]["features"]))

    def of(self, kind: str) -> Sequence[Mapping[str, Any]]:
        """The fields of the records of a type."""
        return self.records.get(kind, ())

    @property
    def expected(self) -> str:
        """Why our reader differs, or empty."""
        if "pad" in self.features:
            return PADDED
        return UNCHUNKED if self.of("Message") and "ch" not in self.features else ""


def _messages(data: bytes) -> list[bytes]:
    """The messages in a chunk."""
    return [data[begin:end] for opcode, begin, end in split(data) if opcode == MESSAGE]


def _message(fields: Mapping[str, Any]) -> bytes:
    """A message as the specification of MCAP writes it."""
    sizes = {"channel_id": 2, "sequence": 4, "log_time": 8, "publish_time": 8}
    head = b"".join(int(fields[name]).to_bytes(size, "little") for name, size in sizes.items())
    return head + bytes(map(int, fields["data"]))


def _problems(path: Path, described: Described) -> Iterator[str]:
    size = path.stat().st_size
    channels = {int(fields["id"]): fields["topic"] for fields in described.of("Channel")}
    with path.open("rb") as file:
        scanned = scan(file, size)
        if scanned.damage or scanned.cut or not scanned.complete:
            yield f"{len(scanned.damage)} damaged parts, {scanned.cut} bytes cut off"
        chunks: list[bytes] = []
        for place in scanned.places:
            file.seek(place.data)
            chunks.append(file.read(place.size))
            if zlib.crc32(chunks[-1]) != place.crc:
                yield "the checksum of a chunk differs"
        if [each for data in chunks for each in _messages(data)] != [
            _message(fields) for fields in described.of("Message")
        ]:
            yield "other messages"
        if {each for data in chunks for each in channels_in(data)} != set(channels.items()):
            yield "other channels"
        summary = read_summary(file, size)
    (footer,) = described.of("Footer")
    if summary.sound != (footer["summary_start"] != "0"):
        yield f"an intact summary: {summary.sound}"
    if summary.sound and summary.topics != (channels if "rch" in described.features else {}):
        yield "other channels in the summary"
    indexed = {int(fields["chunk_start_offset"]) for fields in described.of("ChunkIndex")}
    if summary.sound and set(summary.channels) != indexed:
        yield "other chunks in the summary"


def _refused(path: Path) -> Iterator[str]:
    """Problems with the refusal of a file that is no record of ours."""
    try:
        Chunks(path).close()
    except RecordError as error:
        if "its profile is" not in str(error):
            yield f"it is refused without its profile: {error}"
    else:
        yield "it is read as a record of ours"


def _results(folder: Path) -> Iterator[Result]:
    for path in whole_files(folder.rglob("*.mcap")):
        described = Described.read(path)
        refused = judged(path.stem, _refused(path))
        result = judged(path.stem, _problems(path, described), described.expected)
        yield result if not refused.reason else refused


MCAP = Suite(
    "mcap",
    "foxglove/mcap",
    "tests/conformance/data",
    "the reader of records: scanner, chunks and summary; foreign files are refused by name",
    _results,
)
