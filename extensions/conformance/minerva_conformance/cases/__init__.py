"""The cases of the conformance suite, by what they are about."""

from __future__ import annotations

from typing import Final

from minerva_conformance.case import Case
from minerva_conformance.cases.devices import DEVICES
from minerva_conformance.cases.ending import ENDING
from minerva_conformance.cases.garbage import GARBAGE
from minerva_conformance.cases.generators import GENERATORS
from minerva_conformance.cases.hosts import HOSTS
from minerva_conformance.cases.joining import JOINING
from minerva_conformance.cases.succession import SUCCESSION

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
