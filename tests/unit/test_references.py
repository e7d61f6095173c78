"""What documents name exists: error classes, entries of the glossary, requirements of the protocol."""

import ast
import builtins
import re
from pathlib import Path

import pytest

from minerva_bus import errors
from tests.quick import QUICK, TESTS, left_out
from tools.protocol_tables import protocol

PACKAGE = Path(__file__).parents[2] / "minerva_bus"
LINE = re.compile(r"^    (?P<indent>[│├└─ ]*)(?P<name>[A-Z]\w+)(?P<rest>.*)$")
BUILTIN = {name for name, value in vars(builtins).items() if isinstance(value, type)
           and issubclass(value, BaseException)}  # fmt: skip


def drawn(text):
    """Base and module of each class of a drawn tree, by its name."""
    tree, above = {}, []
    for match in filter(None, map(LINE.match, text.splitlines())):
        depth = len(match["indent"]) // 4
        del above[depth:]
        home = re.search(r"(?<= )[a-z]\w+(\.\w+)+$", match["rest"])
        tree[match["name"]] = (above[-1] if above else "Exception", home[0] if home else "errors")
        above.append(match["name"])
    return tree


def declared(package):
    """Base and module of each exception class of a package, by its name."""
    bases = {}
    for path in sorted(package.rglob("*.py")):
        home = ".".join(path.relative_to(package).with_suffix("").parts)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                for base in node.bases:
                    bases.setdefault(node.name, []).append((ast.unparse(base), home))
    classes, size = {}, -1
    while len(classes) > size:
        size = len(classes)
        for name, places in bases.items():
            for base, home in places:
                if base in classes or base in BUILTIN:
                    classes[name] = (base, home)
    # An interruption or a warning is no error.
    others = ("KeyboardInterrupt", "UserWarning")
    return {name: place for name, place in classes.items() if place[0] not in others}


def test_the_tree_is_complete():
    assert drawn(errors.__doc__) == declared(PACKAGE)


def test_every_class_derives_from_the_root():
    classes = declared(PACKAGE)
    assert {base for base, _ in classes.values()} - classes.keys() == {"Exception"}
    assert [name for name, (base, _) in classes.items() if base == "Exception"] == ["MinervaError"]


@pytest.mark.parametrize("home", sorted({home for _, home in drawn(errors.__doc__).values()}))
def test_the_classes_are_in_the_modules_of_the_tree(home):
    module = __import__(f"minerva_bus.{home}", fromlist=["x"])
    for name, (base, place) in drawn(errors.__doc__).items():
        if place == home:
            cls = getattr(module, name)
            assert issubclass(cls, errors.MinervaError) or name == "MinervaError"
            assert cls.__mro__[1].__name__ == base


def test_a_class_outside_the_tree_is_noticed(tmp_path):
    (tmp_path / "late.py").write_text("class Late(ValueError): pass\nclass Later(Late): pass\n")
    assert declared(tmp_path) == {"Late": ("ValueError", "late"), "Later": ("Late", "late")}


ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if line.startswith("| ") and "`" in line]


def path_of(module):
    """The file of a module: below the kernel, or of an extension."""
    return ROOT / module if module.startswith("extensions/") else ROOT / "minerva_bus" / module


def modules_of(row):
    """The files that a row names; skips where their extension is left out."""
    modules = re.findall(r"`([\w/]+\.py)`", row.rpartition("|")[0].rpartition("|")[2])
    if absent := next(filter(None, map(left_out, modules)), None):
        pytest.skip(f"without extension {absent}")
    return [path_of(module) for module in modules]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_the_modules_of_a_row_exist(row):
    modules = modules_of(row)
    assert modules
    for module in modules:
        assert module.is_file(), module


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_the_classes_of_a_row_are_defined_in_its_modules(row):
    text = "".join(module.read_text(encoding="utf-8") for module in modules_of(row))
    cells = "|".join(row.split("|")[1:-2])
    for name in re.findall(r"`([A-Z]\w+)", cells):
        assert re.search(rf"^(class {name}\b|{name}\b)", text, re.M), name


def test_every_symbol_of_the_paper_is_there():
    for symbol in ("w", "Σ", "P", "T", "ε", "G", "α", "β", "δ", "φ", "λ", "η", "θ", "π"):
        assert f"*{symbol}*" in PAGE


@pytest.mark.parametrize("name", QUICK)
def test_the_files_of_the_quick_run_exist(name):
    assert (TESTS / name).exists() or (ROOT / name).exists() or left_out(name)


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
    identifiers = [match[1] for match in IDENTIFIER.finditer(protocol())]
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


ARCHITECTURE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")


def test_the_files_that_the_architecture_names_exist() -> None:
    names = re.findall(r"`([\w/]+\.py)`", ARCHITECTURE)
    assert len(names) > 40
    assert [
        name
        for name in names
        if not (path_of(name).is_file() or (ROOT / name).is_file() or left_out(name))
    ] == []


@pytest.mark.parametrize(
    ("name", "kilobytes"),
    [("ARCHITECTURE.md", 15), ("PROTOCOL.md", 50), ("docs/performance.md", 20)],
)
def test_a_document_that_grew_into_a_wall_stays_short(name: str, kilobytes: int) -> None:
    assert (ROOT / name).stat().st_size <= kilobytes * 1000
