"""Colours of code blocks: strings of L(M), and languages that stay plain."""

from __future__ import annotations

from typing import Any, ClassVar

from pygments.lexer import RegexLexer
from pygments.lexers.special import TextLexer
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Text
from sphinx.application import Sphinx

PLAIN = ("digest", "hex", "streams")
"""Languages of blocks in PROTOCOL.md and ARCHITECTURE.md that tests read."""


class StringLexer(RegexLexer):
    """Strings of L(M), by Table 1 of the paper."""

    name = "Minerva string"
    tokens: ClassVar[dict[str, Any]] = {
        "root": [
            (r"//.*", Comment.Single),
            (r'"(?:[^"\\]|\\.)*"', String),
            (r"A[A-Za-z0-9_]*", Name.Class),
            (r"T[A-Za-z0-9_]*", Keyword),
            (r"P[A-Za-z0-9_]*", Name.Function),
            (r"#[\w.:~-]+", Name.Label),
            (r"[a-z_]\w*(?==)", Name.Attribute),
            (r"-?\d+(\.\d+)?(e-?\d+)?\s?[a-z°%/]*", Number),
            (r"·|\.\.\.|…|ε", Operator),
            (r"[<>(){}\[\],=]", Punctuation),
            (r"\s+|.", Text),
        ]
    }


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_lexer("mnv", StringLexer)
    for language in PLAIN:
        app.add_lexer(language, TextLexer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
