"""Rules that cannot be compiled: the line, the place in it, and what to write instead."""

import ast
import importlib.util

import pytest
from space.worlds import Sheep, meadow, moment

from minerva_bus.compiled.origin import NotCompilable
from minerva_bus.compiled.refused import EXPRESSIONS, STATEMENTS
from minerva_bus.space import ORDERED, checking, rule

HEAD = """
from minerva_bus.space import ORDERED, Draws, kernel, normal, rule
from space.worlds import Sheep


def plain(x):
    return x


@kernel
def listed(x):
    return [each for each in range(x)]


"""

# What the rule does, where the marker stands, what is refused, and the alternative.
REFUSED = {
    "try": ("try:\n    pass\nexcept ValueError:\n    pass", "try:", "try", "test the condition"),
    "dict": ("x = {1: 2}", "{1: 2}", "a dict", "attributes"),
    "comprehension": (
        "x = [k for k in (1, 2)]",
        "[k for k in (1, 2)]",
        "comprehension",
        "for loop",
    ),
    "text": ("sheep.energy[i] = 'fat'", "'fat'", "a text", "use numbers"),
    "f-string": ("x = f'{i}'", "f'{i}'", "an f-string", "constant texts"),
    "name of a table": ("sheep.enrgy[i] = 1", "sheep.enrgy", "did you mean 'energy'", "numbers"),
    "plain function": ("sheep.energy[i] = plain(1)", "plain(1)", "the function plain", "@kernel"),
    "builtin": ("x = isinstance(i, int)", "isinstance(i, int)", "isinstance", "types"),
    "in a kernel": ("listed(3)", "[each for each in range(x)]", "comprehension", "for loop"),
    "arguments": (
        "x = normal(draws, 1, 2, 3)",
        "normal(draws, 1, 2, 3)",
        "too many",
        "normal(draws,",
    ),
}


def declared(tmp_path, body):
    """The rule with this body, of a module of its own."""
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    path = tmp_path / "ruled.py"
    head = f"{HEAD}@rule(ORDERED)\ndef live(i: int, sheep: Sheep, draws: Draws):\n"
    path.write_text(head + lines)
    spec = importlib.util.spec_from_file_location("ruled", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.live


@pytest.mark.parametrize("case", REFUSED)
def test_a_rule_is_checked_when_it_is_declared(tmp_path, case):
    body, marked, what, instead = REFUSED[case]
    with pytest.raises(NotCompilable) as error:
        declared(tmp_path, body)
    first, place, code, marker, advice = str(error.value).splitlines()
    assert "cannot be compiled: " in first
    assert what in first
    number = int(place.split(":")[1].split(",")[0])
    text = (tmp_path / "ruled.py").read_text().splitlines()[number - 1]
    assert code.strip() == text.strip()
    assert code[marker.index("^") : marker.rindex("^") + 1] == marked
    assert advice.startswith("  instead: ")
    assert instead in advice


def test_rules_and_methods_refuse_constructs_with_the_same_words():
    for node, words in {**STATEMENTS, **EXPRESSIONS}.items():
        assert issubclass(node, ast.AST)
        assert checking.REFUSED[node] is words


def test_what_only_the_compiler_notices_has_its_line(tmp_path):
    live = declared(tmp_path, "x = 1\nsheep.energy[i] = wether")
    with pytest.raises(NotCompilable, match="a name that is not defined") as error:
        meadow().run(moment(), live)
    assert str(error.value).splitlines()[2].strip() == "sheep.energy[i] = wether"


def test_a_rule_without_source_is_not_checked():
    code = compile("def live(i: int, sheep: Sheep):\n    x = {1: 2}\n", "<console>", "exec")
    scope = {"Sheep": Sheep}
    exec(code, scope)
    assert rule(ORDERED)(scope["live"]).name == "live"


def test_a_variable_of_an_enclosing_function_is_refused():
    limit = moment().number

    with pytest.raises(NotCompilable, match="limit, a variable of the function around it"):

        @rule(ORDERED)
        def live(i: int, sheep: Sheep):
            sheep.energy[i] = limit


def test_documentation_messages_of_errors_and_tuples_are_possible(tmp_path):
    lines = [
        '"""Set energies."""',
        'assert i >= 0, "a row"',
        "if i < 0:",
        '    raise ValueError("impossible")',
        "low, high = (1.0, 2.0)",
        "sheep.energy[i] = low + high",
    ]
    space = meadow(sheep=2, wolves=0)
    space.run(moment(), declared(tmp_path, "\n".join(lines)))
    assert Sheep.read(space.sheep).energy.tolist() == [3, 3]
