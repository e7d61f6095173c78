"""Paths as texts: on Linux a name is any bytes, but messages, records and journals have UTF-8."""

from __future__ import annotations

import os
from pathlib import Path


def text_of_path(path: str | Path) -> str:
    r"""The UTF-8 text of a path; bytes that are no UTF-8 are escaped as `\xff`.

    Python decodes names in the encoding of the locale, so `str` of a path would have other
    characters in the locale C, or lone surrogates, which no message can contain.
    """
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def path_of_text(text: str) -> Path:
    """The path that `text_of_path` has made into a text; another one if bytes were escaped."""
    return Path(os.fsdecode(text.encode()))
