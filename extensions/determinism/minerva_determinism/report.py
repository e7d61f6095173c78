"""A certificate as one HTML page: a sentence, a table for each world, and what differs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from minerva_bus.wording import xml_characters
from minerva_determinism.certificate import LEFT_OUT, SAME, TITLES, Certificate, Check
from minerva_determinism.suspects import causes

STYLE: Final = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem;
  color: #1f2430; background: #fff }
table { border-collapse: collapse; width: 100%; margin: .5rem 0 1.5rem }
th, td { text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #d9dce3;
  vertical-align: top }
th { font-weight: 600; color: #5a6272 }
.same { color: #1d7a46 } .out { color: #5a6272 } .bad { color: #b3261e; font-weight: 600 }
pre { margin: .3rem 0; white-space: pre-wrap; color: #5a6272 } code { font-size: .9em }
"""


def page(certificate: Certificate) -> str:
    """The certificate as an HTML document."""
    html = Element("html", lang="en")
    head, body = SubElement(html, "head"), SubElement(html, "body")
    SubElement(head, "meta", charset="utf-8")
    SubElement(head, "meta", name="viewport", content="width=device-width, initial-scale=1")
    _add(head, "title", "Certificate of determinism")
    _add(head, "style", STYLE)
    _add(body, "h1", "Certificate of determinism")
    _add(body, "p", certificate.verdict(), "same" if certificate.is_complete else "bad")
    _add(body, "p", f"Made at {certificate.made} by {certificate.machine}.")
    _add(
        body,
        "p",
        "Each layout below ran the world and was compared frame by frame with the run in one"
        " process. A digest is equal if and only if the string is. Frames x runs were compared.",
    )
    for world, checks in groupby(certificate.checks, lambda check: check.world):
        _add(body, "h2", world)
        _fill(SubElement(body, "table"), checks)
        for name, why in certificate.omitted.get(world, {}).items():
            _add(body, "p", f"Not compared: {name} ({why}).", "out")
        suspects, same = certificate.suspects.get(world, []), not certificate.differs(world)
        if lines := causes(suspects, same=same):
            _add(body, "pre", "\n".join(lines))
    indent(html)
    return "<!DOCTYPE html>\n" + tostring(html, encoding="unicode", method="html") + "\n"


def _fill(table: Element, checks: Iterator[Check]) -> None:
    row = SubElement(table, "tr")
    for title in TITLES:
        _add(row, "th", title)
    for check in checks:
        row = SubElement(table, "tr")
        name, result, *rest = check.cells()
        cell = _add(row, "td", name)
        if check.lines:
            _add(cell, "pre", "\n".join(check.lines))
        kinds = {SAME: "same", LEFT_OUT: "out"}
        _add(row, "td", result, kinds.get(check.result, "bad"))
        for text in rest:
            _add(row, "td", text)


def _add(parent: Element, tag: str, text: str, kind: str = "") -> Element:
    element = SubElement(parent, tag, {"class": kind} if kind else {})
    element.text = xml_characters(text)
    return element
