"""Readers accept external bytes or reject them with an error.

The corpus has well-formed inputs and inputs that once caused failures; python -m checks.fuzz
continues from it. These tests use it unchanged, truncated, and with single bytes changed.
"""

import random
from pathlib import Path

import pytest

from tests.fuzz.targets import TARGETS

CORPUS = Path(__file__).parent / "corpus"
CHANGES = 25


def inputs(name):
    return sorted((CORPUS / name).iterdir())


@pytest.mark.parametrize("name", TARGETS)
def test_the_corpus_is_read_or_refused_in_words(name):
    paths = inputs(name)
    assert paths, "an empty corpus"
    assert all(path.stat().st_size <= 40_000 for path in paths)
    for path in paths:
        TARGETS[name](path.read_bytes())


@pytest.mark.parametrize("name", TARGETS)
def test_so_is_what_was_cut_off_or_changed(name):
    for path in inputs(name):
        data, chance = path.read_bytes(), random.Random(path.name)
        for _ in range(CHANGES):
            changed = bytearray(data[: chance.randrange(len(data) + 1)] or data)
            for _ in range(chance.randrange(4)):
                if changed:
                    changed[chance.randrange(len(changed))] = chance.randrange(256)
            TARGETS[name](bytes(changed))
