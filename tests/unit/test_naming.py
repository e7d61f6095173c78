"""Names and words: no vague variables, one meaning per class name, no archaic expressions.

naming.toml contains the current exceptions; an entry that is no longer needed fails, so the lists
only get shorter.
"""

import ast
import re
import subprocess
import tomllib
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VAGUE = {"one", "found", "mine", "some", "many", "told"}
BASELINE = tomllib.loads(Path(__file__).with_name("naming.toml").read_text(encoding="utf-8"))
PACKAGES = (
    "minerva_bus",
    "services/minerva_services",
    "agents/minerva_agents",
    *sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("extensions/*/minerva_*")),
)
ARCHAIC = re.compile(
    r"\b(anew|of late(?!\s+\w)|by and by|truths|in vain|ever more|the how many(th)?"
    r"|(is|are|was|were|be|been) heard)\b",
    re.IGNORECASE,
)
"""Use instead: again, recently, gradually, bools, without success, increasingly, received."""
VAGUE_BINDING = re.compile(rf"\b(?:{'|'.join(sorted(VAGUE))})\b *(?:[,):]|in\b|=[^=])")
"""What follows a vague name where a loop or a function binds it; other modules are not parsed."""
VAGUE_WORD = re.compile(rf"\b(?:{'|'.join(sorted(VAGUE))})\b *+(?:[^\w.(\[]|in\b)")
"""A vague name that may be bound: no text, attribute or call follows it."""
CLASS = re.compile(r"^class ([^\W_]\w*)", re.MULTILINE)
AUDIBLE = re.compile(r"sound")
"""Paths of texts about audible sounds, in which "heard" is allowed."""
TEXTS = {".py", ".md", ".toml", ".txt", ".js", ".html", ".yaml", ".sh"}
SELF = ("tests/unit/naming.toml", "tests/unit/test_naming.py")


@cache
def modules():
    """The path and the text of each module."""
    return [
        (str(path.relative_to(ROOT)), path.read_text(encoding="utf-8"))
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    ]


def targets(node):
    """The names that a node binds: a variable, or the parameters of a function."""
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id
    elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
        given = node.args
        every = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
        yield from (each.arg for each in every if each is not None)


def vague(text):
    """The number of variables and parameters with a vague name."""
    if not VAGUE_WORD.search(text):
        return 0
    return sum(name in VAGUE for node in ast.walk(ast.parse(text)) for name in targets(node))


def loops_and_parameters(text):
    """The vague names that a module binds in loops and as parameters, each with its line."""
    if not VAGUE_BINDING.search(text):
        return []
    nodes = list(ast.walk(ast.parse(text)))
    loops = [node for node in nodes if isinstance(node, ast.For | ast.AsyncFor | ast.comprehension)]
    bound = [(name.lineno, name.id) for loop in loops for name in ast.walk(loop.target)
             if isinstance(name, ast.Name)]  # fmt: skip
    bound += [(name.lineno, name.arg) for name in nodes if isinstance(name, ast.arg)]
    return sorted((line, name) for line, name in bound if name in VAGUE)


def homonyms():
    """Public class names that several modules define, with these modules."""
    count = Counter(name for _, text in modules() for name in set(CLASS.findall(text)))
    homes = defaultdict(list)
    for path, text in modules():
        if any(count[name] > 1 for name in CLASS.findall(text)):
            for node in ast.parse(text).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    homes[node.name].append(path)
    return {name: paths for name, paths in sorted(homes.items()) if len(paths) > 1}


def archaic(path, text):
    """The archaic expressions of a text, in lower case."""
    expressions = (match[0].lower() for match in ARCHAIC.finditer(text))
    sounds = AUDIBLE.search(path)
    return [item for item in expressions if not (sounds and item.endswith("heard"))]


@cache
def texts():
    """The path and the text of each file of the project: code, documents, help texts."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    return [
        (path, (ROOT / path).read_text(encoding="utf-8"))
        for path in sorted(filter(None, listed.split("\0")))
        if (ROOT / path).suffix in TEXTS and (ROOT / path).is_file()
    ]


@cache
def archaic_files():
    """Files of the project that contain an archaic expression."""
    return [path for path, text in texts() if path not in SELF and archaic(path, text)]


def test_no_more_vague_names_than_in_the_baseline():
    counts = {path: count for path, text in modules() if (count := vague(text))}
    allowed = BASELINE["vague"]
    more = {path: n for path, n in counts.items() if n > allowed.get(path, 0)}
    assert not more, f"name loop variables and parameters by their noun, not one of {VAGUE}"
    assert counts == allowed, "shorten naming.toml: python tests/unit/test_naming.py"


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="lists the files with git")
def test_no_loop_variable_or_parameter_has_a_vague_name():
    """In all modules, tests too; in the packages the test above counts every variable."""
    places = [
        f"{path}:{line}: {name}"
        for path, text in texts()
        if path.endswith(".py")
        for line, name in loops_and_parameters(text)
    ]
    assert not places, "name them by their noun"


def test_a_class_name_has_one_meaning_but_for_the_baseline():
    assert list(homonyms()) == BASELINE["homonyms"], (
        "give a class of its own meaning a name of its own, or shorten naming.toml:"
        " python tests/unit/test_naming.py"
    )


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="lists the files with git")
def test_no_archaic_words_but_for_the_baseline():
    remaining, allowed = archaic_files(), BASELINE["archaic"]
    more = sorted(set(remaining) - set(allowed))
    assert not more, "use plain technical English: see ARCHAIC in this module"
    assert remaining == allowed, "shorten naming.toml: python tests/unit/test_naming.py"


def test_modules_of_tests_have_different_names():
    """pytest imports them by these names alone; a second module of a name ends its collection."""
    paths = defaultdict(list)
    for path in sorted((ROOT / "tests").rglob("*.py")):
        paths[path.name].append(str(path.relative_to(ROOT)))
    del paths["conftest.py"]
    assert [several for several in paths.values() if len(several) > 1] == []


@pytest.mark.parametrize(("path", "text", "expressions"), [
    ("a.py", "Started Anew, of late", ["anew", "of late"]), ("a.md", "It is heard.", ["is heard"]),
    ("docs/sound.md", "It is heard anew.", ["anew"]), ("a.py", "ever_more, renewal, truth", []),
    ("a.py", "the how manyth of them", ["the how manyth"]),
])  # fmt: skip
def test_archaic_words_are_recognized(path, text, expressions):
    assert archaic(path, text) == expressions


@pytest.mark.parametrize(("code", "count"), [
    ("for one in x: pass", 1), ("[one for one in x]", 1), ("for a, (many, b) in x: pass", 1),
    ("def f(told, *some, mine=1): pass", 3), ("lambda found: 0", 1), ("one = 1", 1),
    ("one += 1", 1), ("with x as told: pass", 1), ("[*some] = x", 1), ("one: int = 1", 1),
    ("(x\n, many\n) = y", 1), ("(one := 1)", 1), ("x.found = mine(some.y)", 0),
    ("for event in x: pass", 0),
])  # fmt: skip
def test_vague_names_are_counted(code, count):
    assert vague(code) == count


@pytest.mark.parametrize(("code", "names"), [
    ("for one in x:\n    pass", ["one"]), ("[x for x in y for a, (many, b) in x]", ["many"]),
    ("def f(told, /, *some, mine=1, **found): pass", ["found", "mine", "some", "told"]),
    ("lambda found: 0", ["found"]), ("async def f(one: int): pass", ["one"]),
    ("found = one\nf(many=1)\nfor event in some:\n    told: int = 1", []),
])  # fmt: skip
def test_vague_loop_variables_and_parameters_are_listed(code, names):
    assert [name for _, name in loops_and_parameters(code)] == names


def write_baseline():
    """Write naming.toml for the current names: `python tests/unit/test_naming.py`."""
    counts = {path: count for path, text in modules() if (count := vague(text))}
    lines = ["# Exceptions of test_naming.py: `python tests/unit/test_naming.py` writes them.", ""]
    lines += ["homonyms = [", *(f'    "{name}",' for name in homonyms()), "]", ""]
    lines += ["archaic = [", *(f'    "{path}",' for path in archaic_files()), "]", "", "[vague]"]
    lines += [f'"{path}" = {count}' for path, count in counts.items()]
    Path(__file__).with_name("naming.toml").write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    write_baseline()
