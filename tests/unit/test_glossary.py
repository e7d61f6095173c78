"""docs/glossary.md: the modules and classes that it names exist."""

import re
from pathlib import Path

import pytest

from tests.quick import QUICK, TESTS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| ") and "`" in line]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_the_modules_of_a_row_exist(row):
    modules = re.findall(r"`([\w/]+\.py)`", row.rpartition("|")[0].rpartition("|")[2])
    assert modules
    for module in modules:
        assert (ROOT / "minerva_bus" / module).is_file(), module


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_the_classes_of_a_row_are_defined_in_its_modules(row):
    text = "".join(
        (ROOT / "minerva_bus" / module).read_text(encoding="utf-8")
        for module in re.findall(r"`([\w/]+\.py)`", row)
    )
    cells = "|".join(row.split("|")[1:-2])
    for name in re.findall(r"`([A-Z]\w+)", cells):
        assert re.search(rf"^(class {name}\b|{name}\b)", text, re.M), name


def test_every_symbol_of_the_paper_is_there():
    for symbol in ("w", "Σ", "P", "T", "ε", "G", "α", "β", "δ", "φ", "λ", "η", "θ", "π"):
        assert f"*{symbol}*" in PAGE


@pytest.mark.parametrize("name", QUICK)
def test_the_files_of_the_quick_run_exist(name):
    assert (TESTS / name).exists()
