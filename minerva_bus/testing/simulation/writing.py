"""Histories as lines of JSON: what failed once is kept as it was, whatever seeds draw later."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any, cast

from minerva_bus.testing.simulation.history import Act, Fault, History


def written(history: History, reason: str) -> str:
    """A history in one line, with the reason why it is kept."""
    return json.dumps({"reason": reason, **asdict(history)})


def read_back(line: str) -> tuple[History, str]:
    """A history and its reason. Raises ValueError, TypeError or KeyError for another line."""
    plain = cast("dict[str, Any]", json.loads(line))
    reason = str(plain.pop("reason"))
    faults = tuple([Fault(**one) for one in plain.pop("faults")])
    acts = tuple([Act(**one) for one in plain.pop("acts")])
    return replace(History(**plain), faults=faults, acts=acts), reason
