"""From sentences of NMEA 0183 to fixes, on pynmea2 (extra `serial`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from minerva_bus.errors import MinervaError


class Useless(MinervaError):
    """A line that says no position; its message is what such lines are counted as."""


@dataclass(frozen=True, slots=True)
class Fix:
    """Where a receiver is: degrees north and east (WGS 84).

    `altitude` is in metres above the ellipsoid, or above the sea where the receiver does not say
    how far these are apart; `dilution` is the horizontal one (HDOP). They are None where the
    sentence does not have them; a dilution of 0, which some receivers send, is unknown too.
    `second` counts from midnight, UTC.
    """

    sentence: str
    latitude: float
    longitude: float
    altitude: float | None
    dilution: float | None
    second: float


def read_fix(line: str) -> Fix:
    """The fix in a GGA or RMC sentence, of whatever talker. Raises Useless."""
    found = _parsed(line)
    kind = str(getattr(found, "sentence_type", ""))
    if kind not in ("GGA", "RMC"):
        raise Useless("other sentences")
    try:
        return _fix(kind, found)
    except (ValueError, TypeError, AttributeError):
        raise Useless("garbage") from None


def _parsed(line: str) -> Any:
    import pynmea2

    try:
        return pynmea2.parse(line[max(line.rfind("$"), 0) :], check=True)
    except pynmea2.ChecksumError:
        raise Useless("checksum errors") from None
    except pynmea2.SentenceTypeError:
        raise Useless("other sentences") from None
    except (pynmea2.ParseError, ValueError):
        raise Useless("garbage") from None


def _fix(kind: str, found: Any) -> Fix:
    known = int(found.gps_qual or 0) > 0 if kind == "GGA" else found.status == "A"
    if not known or not found.lat or not found.lon:
        raise Useless("without a fix")
    at = found.timestamp
    second = at.hour * 3600 + at.minute * 60 + at.second + at.microsecond / 1e6
    latitude, longitude = float(found.latitude), float(found.longitude)
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise Useless("garbage")
    if kind == "RMC":
        return Fix(kind, latitude, longitude, None, None, second)
    above_sea, dilution = _real(found.altitude), _real(found.horizontal_dil) or None
    altitude = above_sea if above_sea is None else above_sea + (_real(found.geo_sep) or 0.0)
    return Fix(kind, latitude, longitude, altitude, dilution, second)


def _real(value: Any) -> float | None:
    if value in (None, ""):
        return None
    number = float(value)
    if not math.isfinite(number):
        raise ValueError
    return number
