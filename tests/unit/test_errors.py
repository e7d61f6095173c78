"""The tree at the top of errors.py has every error class of the package, under its base."""

import ast
import builtins
import re
from pathlib import Path

import pytest

from minerva_bus import errors

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
