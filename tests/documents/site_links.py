"""The built documentation site, and links in it and in Markdown files."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, field
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token
from myst_parser.slugs import github_slugify, unique_slug
from pages import ROOT

from tests.patience import patience
from tests.quick import left_out

TARGETS = {"a": "href", "img": "src", "link": "href", "script": "src", "source": "src"}
"""Attributes of HTML elements that name other files."""


def build(folder: Path) -> subprocess.CompletedProcess[str]:
    """Build the site in a folder with warnings as errors."""
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-d",
        f"{folder}.doctrees",
        "-D",
        f"nb_execution_timeout={patience(100):.0f}",
    ]
    return subprocess.run([*command, "docs", folder], cwd=ROOT, capture_output=True, text=True)


@dataclass
class Page(HTMLParser):
    """An HTML file: its anchors, the files and anchors that it names, and images without a text."""

    path: Path
    anchors: set[str] = field(default_factory=set)
    targets: list[str] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.anchors |= {value for name, value in attrs if value and name in ("id", "name")}
        if target := values.get(TARGETS.get(tag, "")):
            self.targets.append(target)
        if tag == "img" and "alt" not in values:
            self.silent.append(values.get("src") or "")


@cache
def page(path: Path) -> Page:
    return Page(path)


def is_local(target: str) -> bool:
    parts = urlsplit(target)
    return not parts.scheme and not parts.netloc


def broken(path: Path) -> list[str]:
    """Targets of an HTML file whose file or anchor does not exist."""
    missing = []
    for target in filter(is_local, page(path).targets):
        parts = urlsplit(target)
        file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        if not file.is_file():
            missing.append(target)
        elif parts.fragment and file.suffix == ".html":
            missing += [] if unquote(parts.fragment) in page(file).anchors else [target]
    return missing


@cache
def tokens(path: Path) -> list[Token]:
    reader = MarkdownIt("commonmark").enable("table")
    return reader.parse(path.read_text(encoding="utf-8"))


@cache
def headings(path: Path) -> set[str]:
    """Anchors that a repository browser gives to the headings of a Markdown file."""
    slugs: set[str] = set()
    for opening, title in zip(tokens(path), tokens(path)[1:], strict=False):
        if opening.type == "heading_open":
            text = "".join(part.content for part in title.children or [] if part.content)
            slugs.add(unique_slug(github_slugify(text), slugs))
    return slugs


def broken_in_markdown(path: Path) -> list[str]:
    """Relative links and images of a Markdown file that a repository browser cannot open."""
    inline = [part for token in tokens(path) for part in token.children or []]
    targets = [str(part.attrs.get("href") or part.attrs.get("src") or "") for part in inline]
    missing = []
    for target in filter(is_local, filter(None, targets)):
        parts = urlsplit(target)
        file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        if file.is_relative_to(ROOT) and left_out(file.relative_to(ROOT)):
            continue
        if not file.exists() or ROOT not in (file, *file.parents):
            missing.append(target)
        elif parts.fragment and file.suffix == ".md":
            missing += [] if parts.fragment in headings(file) else [target]
    return missing
