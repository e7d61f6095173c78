"""The cases of the conformance suite, by what they are about."""

from __future__ import annotations

from typing import Final

from minerva_bus.testing.conformance.case import Case
from minerva_bus.testing.conformance.cases.devices import DEVICES
from minerva_bus.testing.conformance.cases.ending import ENDING
from minerva_bus.testing.conformance.cases.garbage import GARBAGE
from minerva_bus.testing.conformance.cases.generators import GENERATORS
from minerva_bus.testing.conformance.cases.hosts import HOSTS
from minerva_bus.testing.conformance.cases.joining import JOINING
from minerva_bus.testing.conformance.cases.succession import SUCCESSION

CASES: Final[tuple[Case, ...]] = (
    *JOINING,
    *GENERATORS,
    *HOSTS,
    *DEVICES,
    *SUCCESSION,
    *ENDING,
    *GARBAGE,
)
"""All cases; their identifiers are unique."""
