"""For any texts and numbers, the document is well-formed and shows them unchanged."""

from xml.etree import ElementTree

import pytest
from svg_world import PSign, elements, picture

from minerva_services.views.svg.markup import exact, line_of_text, paint, short

HOSTILE = [
    "</text></svg><script>alert(1)</script>",
    "<![CDATA[ ]]> &amp; &lt; &#0; <!-- -->",
    "\"quotes\" 'apostrophes' \\ % {braces}",
    "\x00\x01\x1b[31m\ufffe\uffff",
    "žluťoučký 東京 🤖",
    "line\nbreak\ttab\r\n",
    "x" * 1_000_000,
    "",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_label_stays_a_text(text: str):
    document = picture(PSign(text))
    document.encode()
    root = ElementTree.fromstring(document)
    tags = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert tags <= {"svg", "title", "rect", "g", "path", "circle", "text", "tspan"}
    assert len(document) < 6000


def test_a_label_reads_as_it_was_written():
    shown = [e.text for e in elements(picture(PSign("<A & B> 'žluť' 東京")), "text")]
    assert "<A & B> 'žluť' 東京" in shown


def test_texts_are_cut_to_one_line():
    assert line_of_text("a\n b\t\tc ") == "a b c"
    assert line_of_text("\ud800\x00a") == "\ufffd\ufffda"
    assert line_of_text("x" * 100) == "x" * 59 + "…"


def test_numbers_are_short():
    assert [short(n) for n in (1.0, 0.12345, -2.5, 1e300, 123456.7894)] == [
        "1", "0.123", "-2.5", "1000000000", "123456.789",
    ]  # fmt: skip
    assert exact(0.0375) == "0.0375"


def test_colours_are_colours():
    assert [paint(c) for c in ("#123", "#A0b1C2", "teal")] == ["#123", "#A0b1C2", "teal"]
