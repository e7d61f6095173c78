"""Write the settings tables in docs/: run `python -m tools.settings_tables`.

Tables are generated from declarations. Each is between `<!-- settings: NAME ... -->`, which lists
classes of settings/world_settings.py, and `<!-- end of settings -->`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from minerva_bus.settings import world_settings
from minerva_bus.settings.kinds import Setting, settings_of
from tools import blocks

DOCS = Path(__file__).parents[1] / "docs"
PAGES = (DOCS / "worlds.md", DOCS / "norms.md")


def table_of(classes: Sequence[type[Any]], qualified: bool = False) -> str:
    """The Markdown table of these settings; `qualified`: keys include the name of their table."""
    settings = [each for cls in classes for each in settings_of(cls).values() if each.key]
    options = any(each.option for each in settings)
    titles = ["key", "type", "default", *(["option"] if options else []), "meaning"]
    lines = [_row(titles), _row(["---"] * len(titles))]
    for each in settings:
        key = f"{each.table}.{each.key}" if qualified else each.key
        option = [f"`{each.flag}`" if each.option else ""] if options else []
        kind = each.form or each.kind.phrase
        meaning = f"{each.help} {each.more}".strip()
        lines.append(_row([f"`{key}`", kind, _default(each), *option, meaning]))
    return "\n".join(lines)


def _row(cells: list[str]) -> str:
    return " ".join(["|", *(f"{cell} |".strip() for cell in cells)])


def _default(setting: Setting) -> str:
    if setting.shown:
        return setting.shown
    value = setting.default
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "`[]`"
    return f"{value:g}" if isinstance(value, float | int) else f'`"{value}"`' if value else "none"


def filled(text: str) -> str:
    """A page with its tables up to date. Exits for an incomplete pair of markers."""

    def make(name: str) -> str:
        names = name.split()
        classes = [getattr(world_settings, f"{each}Settings") for each in names]
        return f"\n{table_of(classes, qualified='Watch' in names)}\n\n"

    return blocks.filled(text, "settings", make)


def main() -> None:
    """Write the tables of all pages."""
    for page in PAGES:
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
