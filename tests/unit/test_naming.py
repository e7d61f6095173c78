"""Names say what they stand for: no vague variables, and a class name has one meaning.

naming.toml has the exceptions of today; an entry that is no longer needed fails, so the lists only
get shorter.
"""

import ast
import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VAGUE = {"one", "found", "mine", "some", "many", "told"}
BASELINE = tomllib.loads(Path(__file__).with_name("naming.toml").read_text(encoding="utf-8"))
PACKAGES = ("minerva_bus", "services/minerva_services", "agents/minerva_agents")


@cache
def modules():
    """The path and the syntax tree of each module."""
    return [
        (str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8")))
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    ]


def targets(node):
    """The names that a loop, a comprehension or a function binds."""
    if isinstance(node, ast.For | ast.AsyncFor | ast.comprehension):
        yield from (name.id for name in ast.walk(node.target) if isinstance(name, ast.Name))
    elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
        given = node.args
        every = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
        yield from (each.arg for each in every if each is not None)


def vague(tree):
    """How many loop variables and parameters have a name without a meaning."""
    return sum(name in VAGUE for node in ast.walk(tree) for name in targets(node))


def homonyms():
    """Public class names that are defined in more than one module, with these modules."""
    homes = defaultdict(list)
    for path, tree in modules():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(path)
    return {name: paths for name, paths in sorted(homes.items()) if len(paths) > 1}


def test_no_more_vague_names_than_in_the_baseline():
    counts = {path: count for path, tree in modules() if (count := vague(tree))}
    allowed = BASELINE["vague"]
    more = {path: n for path, n in counts.items() if n > allowed.get(path, 0)}
    assert not more, f"name loop variables and parameters by their noun, not one of {VAGUE}"
    assert counts == allowed, "shorten naming.toml: python tests/unit/test_naming.py"


def test_a_class_name_has_one_meaning_but_for_the_baseline():
    assert list(homonyms()) == BASELINE["homonyms"], (
        "give a class of its own meaning a name of its own, or shorten naming.toml:"
        " python tests/unit/test_naming.py"
    )


@pytest.mark.parametrize(("code", "count"), [
    ("for one in x: pass", 1), ("[one for one in x]", 1), ("for a, (many, b) in x: pass", 1),
    ("def f(told, *some, mine=1): pass", 3), ("lambda found: 0", 1), ("one = 1", 0),
    ("for event in x: pass", 0),
])  # fmt: skip
def test_vague_names_are_counted(code, count):
    assert vague(ast.parse(code)) == count


def write_baseline():
    """Write naming.toml for the names of today: `python tests/unit/test_naming.py`."""
    counts = {path: count for path, tree in modules() if (count := vague(tree))}
    lines = ["# Exceptions of test_naming.py: `python tests/unit/test_naming.py` writes them.", ""]
    lines += ["homonyms = [", *(f'    "{name}",' for name in homonyms()), "]", "", "[vague]"]
    lines += [f'"{path}" = {count}' for path, count in counts.items()]
    Path(__file__).with_name("naming.toml").write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    write_baseline()
