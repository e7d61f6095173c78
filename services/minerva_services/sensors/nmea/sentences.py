"""NMEA 0183 sentences as fixes, using pynmea2 (extra `serial`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import MinervaError

MAX_SHOWN: Final = 90
"""Characters of a sentence that are shown."""


class SkippedSentence(MinervaError):
    """A line without a usable position; the message is the name of the counter for such lines.

    `detail` describes a sentence that arrived intact, but has an invalid value.
    """

    def __init__(self, counter: str, detail: str = "") -> None:
        super().__init__(counter)
        self.detail = detail


@dataclass(frozen=True, slots=True)
class Fix:
    """A receiver's position in degrees north and east (WGS 84).

    `altitude` is in metres above the ellipsoid, or above sea level if the receiver omits the
    difference; `dilution` is the horizontal one (HDOP). They are None if absent; a dilution of 0,
    which some receivers send, is also unknown. `second` counts from midnight UTC.
    """

    sentence: str
    latitude: float
    longitude: float
    altitude: float | None
    dilution: float | None
    second: float


def read_fix(line: str) -> Fix:
    """The fix in a GGA or RMC sentence of any talker. Raises SkippedSentence."""
    sentence = _parsed(line)
    kind = str(getattr(sentence, "sentence_type", ""))
    if kind not in ("GGA", "RMC"):
        raise SkippedSentence("other sentences")
    try:
        return _fix(kind, sentence)
    except (ValueError, TypeError, AttributeError) as error:
        raise SkippedSentence("garbage", f"{line[:MAX_SHOWN]!r} skipped: {error}") from None


def _parsed(line: str) -> Any:
    import pynmea2

    try:
        # If a line end was lost, the remains of another sentence precede the last $. Without
        # `check`, pynmea2 accepts sentences that lack a checksum.
        return pynmea2.parse(line[max(line.rfind("$"), 0) :], check=True)
    # Both of these are subclasses of ParseError, so they come first.
    except pynmea2.ChecksumError:
        raise SkippedSentence("checksum errors") from None
    except pynmea2.SentenceTypeError:
        raise SkippedSentence("other sentences") from None
    except (pynmea2.ParseError, ValueError):
        raise SkippedSentence("garbage") from None


def _fix(kind: str, sentence: Any) -> Fix:
    known = int(sentence.gps_qual or 0) > 0 if kind == "GGA" else sentence.status == "A"
    if not known or not sentence.lat or not sentence.lon:
        raise SkippedSentence("without a fix")
    at = sentence.timestamp
    second = at.hour * 3600 + at.minute * 60 + at.second + at.microsecond / 1e6
    latitude = _degrees(sentence.latitude, sentence.lat, sentence.lat_dir, "NS", 90)
    longitude = _degrees(sentence.longitude, sentence.lon, sentence.lon_dir, "EW", 180)
    if kind == "RMC":
        return Fix(kind, latitude, longitude, None, None, second)
    above_sea, dilution = _real(sentence.altitude), _real(sentence.horizontal_dil) or None
    altitude = above_sea if above_sea is None else above_sea + (_real(sentence.geo_sep) or 0.0)
    return Fix(kind, latitude, longitude, altitude, dilution, second)


def _degrees(degrees: float, text: str, hemisphere: str, known: str, most: float) -> float:
    """Degrees, given the fields that they were read from. Raises ValueError."""
    # pynmea2 reads 0 degrees without a known hemisphere, and more minutes than a degree has.
    if hemisphere not in tuple(known):
        raise ValueError(f"hemisphere {hemisphere!r}; expected {' or '.join(known)}")
    minutes = float(text[max(0, text.find(".") - 2) :])
    if abs(degrees) > most or minutes > 60:
        raise ValueError(f"{text} is not degrees and minutes up to {most}°")
    return degrees


def _real(value: Any) -> float | None:
    if value in (None, ""):
        return None
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value} is not finite")
    return number
