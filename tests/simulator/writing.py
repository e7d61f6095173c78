"""Histories as lines of JSON: failures stay reproducible when the generator changes."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any, cast

from tests.simulator.history import Fault, History, Operation


def written(history: History, reason: str) -> str:
    """A history as one line, with the reason for keeping it."""
    return json.dumps({"reason": reason, **asdict(history)})


def read_back(line: str) -> tuple[History, str]:
    """Parse a history and its reason. Raises ValueError, TypeError or KeyError."""
    plain = cast("dict[str, Any]", json.loads(line))
    reason = str(plain.pop("reason"))
    faults = tuple([Fault(**fault) for fault in plain.pop("faults")])
    acts = tuple([Operation(**act) for act in plain.pop("acts")])
    return replace(History(**plain), faults=faults, acts=acts), reason
