"""Identifiers of the requirements in PROTOCOL.md: unique, in their section, and complete."""

import re
from pathlib import Path

import pytest

DOCUMENT = (Path(__file__).parents[2] / "PROTOCOL.md").read_text(encoding="utf-8")
IDENTIFIER = re.compile(r"\[(P(\d+)\.\d+)\]")
CODE = re.compile(r"^```.*?^```$", re.M | re.S)
PARAGRAPH_END = re.compile(r"\n\s*\n|\n(?=[-|#]|\d+\. )")
SENTENCE_END = re.compile(r"(?<=[.:?])\s+(?=[A-Z`*\[(])")


def sections(document: str) -> list[tuple[int, str]]:
    """The number and the text of each section, without code."""
    _, *parts = re.split(r"^## (\d+)\. ", CODE.sub("", document), flags=re.M)
    return [(int(number), text) for number, text in zip(parts[::2], parts[1::2], strict=True)]


def sentences(text: str) -> list[str]:
    """The sentences of a text; an identifier is part of the sentence that it precedes."""
    paragraphs = PARAGRAPH_END.split(text)
    return [sentence for part in paragraphs for sentence in SENTENCE_END.split(part)]


def unmarked(document: str) -> list[str]:
    """Sentences with "must" that no identifier precedes."""
    return [
        sentence
        for _, text in sections(document)
        # An identifier and its sentence are two pieces after the split at "]".
        for sentence in sentences(re.sub(r"\[(P\d+\.\d+)\]\s+", r"[\1]", text))
        if re.search(r"\bmust\b", sentence, re.I) and not IDENTIFIER.search(sentence)
    ]


def test_identifiers_are_unique() -> None:
    identifiers = [match[1] for match in IDENTIFIER.finditer(DOCUMENT)]
    assert len(identifiers) > 100
    assert sorted(set(identifiers)) == sorted(identifiers)


def test_identifiers_have_the_number_of_their_section() -> None:
    for number, text in sections(DOCUMENT):
        for match in IDENTIFIER.finditer(text):
            assert int(match[2]) == number, match[0]


def test_every_sentence_with_must_has_an_identifier() -> None:
    assert unmarked(DOCUMENT) == []


@pytest.mark.parametrize(("text", "count"), [
    ("[P1.1] It must answer. It may leave.", 0), ("It may leave. It must answer.", 1),
    ("[P1.1] It may leave. It must answer.", 1), ("- [P1.1] **x** must be.\n- It must not be.", 1),
    ("```\nit must\n```\n", 0),
])  # fmt: skip
def test_missing_identifiers_are_recognized(text: str, count: int) -> None:
    assert len(unmarked(f"## 1. Topology\n\n{text}\n")) == count
