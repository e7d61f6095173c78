"""Command line of a benchmark: options, and results as aligned text or lines of JSON."""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class Option:
    """An option with its default, its help text and, if restricted, its allowed values."""

    default: Any
    help: str = ""
    choices: Iterable[str] | None = None


# Without the variable, which lets each process compile the project again.
ENVIRONMENT: Final = {
    name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
}
PLOT = Option(Path, "a picture, .svg or .png")
PEERS_FOLDER = Option(Path("../shared/peers"), "scripts of other systems")


def options(
    document: str | None, words: Sequence[str] | None = None, **declared: Any
) -> argparse.Namespace:
    """Parse the command line of a benchmark; `--json` and the options of `declared`.

    A value of `declared` is an `Option` or its default, which gives the type: a list takes one or
    more values, a bool is a flag, and a type has the default None.
    """
    parser = argparse.ArgumentParser(description=(document or "").splitlines()[0])
    for name, value in declared.items():
        option = value if isinstance(value, Option) else Option(value)
        default, flag = option.default, "--" + name.replace("_", "-")
        if default is False:
            parser.add_argument(flag, action="store_true", help=option.help)
            continue
        kind = default if isinstance(default, type) else type(default)
        settings: dict[str, Any] = {"type": kind, "default": default}
        if isinstance(default, list):
            settings |= {"type": type(default[0]), "nargs": "+"}
        elif isinstance(default, type):
            settings["default"] = None
        parser.add_argument(flag, help=option.help, choices=option.choices, **settings)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args(words)


class Table:
    """Prints the column titles, unless `as_json`, and then one row at a time.

    `columns` maps the title of each column to its format, such as `{"µs": ">8.0f"}`. The width of a
    column is that of its format.
    """

    def __init__(self, columns: Mapping[str, str], *, as_json: bool) -> None:
        self._formats = list(columns.values())
        self._as_json = as_json
        if not as_json:
            titles = zip(columns, map(_alignment, self._formats), strict=True)
            print(" ".join(f"{title:{width}}" for title, width in titles), flush=True)

    def row(self, row: Mapping[str, Any], *values: Any) -> None:
        """Print `row` as JSON, or `values` (those of `row` if there are none) as text."""
        if self._as_json:
            print(json.dumps(row), flush=True)
            return
        cells = zip(values or row.values(), self._formats, strict=True)
        print(" ".join(_cell(value, layout) for value, layout in cells), flush=True)


def _alignment(layout: str) -> str:
    match = re.match(r"[<>^]?\d+", layout)
    assert match is not None, layout
    return match[0]


def _cell(value: Any, layout: str) -> str:
    return f"{'':{_alignment(layout)}}" if value is None else f"{value:{layout}}"
