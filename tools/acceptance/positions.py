"""NMEA 0183: the positions of the bridge beside those that gpsd reports for the same log."""

from __future__ import annotations

import ast
import json
import re
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from functools import reduce
from io import StringIO
from operator import xor
from pathlib import Path

from minerva_bus.world.readings import Position
from minerva_services.bridging import SourceError
from minerva_services.sensors.nmea import Nmea
from minerva_services.sensors.nmea.service import SkippedSentence, read_fix
from tools.acceptance.suite import Result, Suite, judged

Place = tuple[float, float]

EXACT_DEGREES = 1e-6
"""Largest difference in degrees (0.1 m); gpsd prints nine decimals."""

_POSITIONED = re.compile(rb"\$[A-Z]{2}(GGA|GNS|RMC|GLL),")

CYCLE_SECONDS = 2.0

OTHER_PROTOCOLS = "a binary or proprietary protocol without sentences of a position: no fixes"
FEWER_SENTENCES = "gpsd takes positions from several types of sentences, the bridge from the best"
LAST_CYCLE = "gpsd reports a cycle when the next one begins: none for the last one before a gap"
NO_FIX = "gpsd reports a position that the receiver's GGA and RMC mark as no fix"
MERGED = "gpsd merges the sentences of a cycle, and reports the last of their positions"
REASONS = {
    "bundg_zeus_9": MERGED,
    "ericsson-gru04-02-70sec": "gpsd also reads the proprietary sentences of the receiver",
    "garmin-geko201": "the receiver has a fix by GGA (simulated), none by RMC; gpsd reports none",
    "hemi": "gpsd reports no position in the first 7.5 s with a fix",
    "humminbird-M37": MERGED,
    "mtk-3301": NO_FIX,
    "myguide-3100": NO_FIX,
    "rst39": "gpsd reports no position while it learns the cycle of the receiver",
    "tr737A+": NO_FIX,
    "ublox8-uniqid-monhw": "gpsd also reads the binary messages between the sentences",
}
"""Reasons of differences that were examined by hand, by log."""


class _Log:
    """A log as a serial line, which is unplugged at its end."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def read(self) -> bytes:
        if not self._data:
            raise SourceError("the log ends")
        data, self._data = self._data[:4096], self._data[4096:]
        return data


def _ours(data: bytes) -> list[Position]:
    """What the bridge publishes."""
    positions: list[Position] = []
    try:
        with redirect_stdout(StringIO()):  # The log of the bridge.
            for item in Nmea()._positions(_Log(data), threading.Event()):  # pyright: ignore
                positions += [item[1]] if item else []
    except SourceError:
        return positions
    raise AssertionError("the end of a log is a lost line")


def _readable(data: bytes) -> set[Place]:
    """Positions in all sentences, also in those that the bridge passes over for better ones."""
    places: set[Place] = set()
    for line in re.split(r"[\r\n]+", data.decode("ascii", "replace")):
        with suppress(SkippedSentence):
            fix = read_fix(line.strip())
            places.add((fix.latitude, fix.longitude))
    return places


def _theirs(check: Path) -> set[Place]:
    """Positions that gpsd reports."""
    text = check.read_text(encoding="utf-8", errors="replace")
    reports = [json.loads(line) for line in text.splitlines() if line.startswith('{"class":"TPV"')]
    return {(each["lat"], each["lon"]) for each in reports if "lat" in each and "lon" in each}


def _has(places: set[Place], place: Place) -> bool:
    return any(
        abs(place[0] - other[0]) <= EXACT_DEGREES and abs(place[1] - other[1]) <= EXACT_DEGREES
        for other in places
    )


def _ends_a_cycle(positions: Sequence[Position], index: int) -> bool:
    """Whether no position follows in the next cycle."""
    following = positions[index + 1 : index + 2]
    return all(abs(each.time - positions[index].time) > CYCLE_SECONDS for each in following)


def _result(log: Path, check: Path) -> Result:
    data = log.read_bytes()
    positions, theirs = _ours(data), _theirs(check)
    places = [(each.latitude, each.longitude) for each in positions]
    added = [index for index, place in enumerate(places) if not _has(theirs, place)]
    lost = [place for place in theirs if not _has(set(places), place)]
    problems = [f"{len(added)} positions unknown to gpsd, as {places[added[0]]}"] if added else []
    problems += [f"{len(lost)} positions are lost, as {min(lost)}"] if lost else []
    expected = REASONS.get(log.stem, "")
    if not _POSITIONED.search(data) and not positions:
        expected = OTHER_PROTOCOLS
    elif added and not lost and all(_ends_a_cycle(positions, index) for index in added):
        expected = LAST_CYCLE
    elif lost and not added and all(_has(_readable(data), place) for place in lost):
        expected = FEWER_SENTENCES
    return judged(log.stem, problems, expected)


def _results(folder: Path) -> Iterator[Result]:
    for log in sorted(folder.glob("*.log")):
        check = log.with_name(f"{log.name}.chk")
        if check.exists():
            yield _result(log, check)


GPSD = Suite(
    "gpsd",
    "ntpsec/gpsd",
    "test/daemon",
    "the bridge `nmea`: positions of gpsd's logs of receivers; other protocols give none",
    _results,
)

_LISTED = re.compile(
    r"<NMEA\([A-Z]{2}(?:GGA|GNS|RMC|GLL),[^<]*?\blat=(-?[\d.]+),[^<]*?\blon=(-?[\d.]+)"
)

UNCHECKED = "tests of pynmeagps that ignore checksums also list sentences that are damaged"
ALL_SENTENCES = "its tests list positions of all types of sentences, the bridge those of the best"
UNLISTED = "no test of pynmeagps lists positions of this log, and the bridge reads whole sentences"


def _listed(tests: Iterable[Path]) -> Mapping[str, set[Place]]:
    """Positions that tests list, by the log that they read."""
    places: dict[str, set[Place]] = {}
    for path in tests:
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.FunctionDef):
                texts = [
                    each.value
                    for each in ast.walk(node)
                    if isinstance(each, ast.Constant) and isinstance(each.value, str)
                ]
                pairs = [pair for text in texts for pair in _LISTED.findall(text)]
                for log in (text for text in texts if text.endswith(".log")):
                    known = places.setdefault(log, set())
                    known.update((float(north), float(east)) for north, east in pairs)
    return places


def _damaged(log: Path, listed: set[Place]) -> Result:
    """The positions of a log, which may be damaged, beside those that its tests list."""
    data = log.read_bytes()
    places, readable = {(each.latitude, each.longitude) for each in _ours(data)}, _readable(data)
    added = [place for place in places if not _has(listed, place)]
    problems = [f"{len(added)} positions that no test lists, as {added[0]}"] if added else []
    lost = [place for place in listed if not _has(places, place)]
    problems += [f"{len(lost)} positions are lost, as {min(lost)}"] if lost else []
    expected = ""
    if added and not listed and all(_has(readable, place) for place in added):
        expected = UNLISTED
    elif lost and not added:
        fewer = all(_has(readable, place) for place in lost)
        expected = ALL_SENTENCES if fewer else UNCHECKED if _is_damaged(data) else ""
    return judged(log.stem, problems, expected)


def _is_damaged(data: bytes) -> bool:
    """Whether a sentence of a position has a wrong checksum."""
    sentences = re.findall(rb"\$([A-Z]{2}(?:GGA|GNS|RMC|GLL),[^*\r\n]*)\*(\w\w)", data)
    return any(reduce(xor, body) != int(checksum, 16) for body, checksum in sentences)


def _damaged_results(folder: Path) -> Iterator[Result]:
    listed = _listed(sorted(folder.glob("test_*.py")))
    for log in sorted(folder.glob("*.log")):
        yield _damaged(log, listed.get(log.name, set()))


PYNMEAGPS = Suite(
    "pynmeagps",
    "semuconsulting/pynmeagps",
    "tests",
    "the bridge `nmea`: positions of whole sentences among damaged and foreign ones",
    _damaged_results,
)
