"""Table 1: the production rules of grammar M, and texts outside L(M)."""

import pytest

from minerva_bus.errors import GrammarError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import EMPTY, AgentNode, FigureNode, TransformationNode


def test_rule_1_a_world_is_objects():
    assert [node.symbol for node in parse("PMap · TMove(PRobot) · ARobot").nodes] == [
        "PMap",
        "TMove",
        "ARobot",
    ]


@pytest.mark.parametrize(
    "text", ["PA · PB · PC", "PA.PB.PC", "PA·PB . PC", "PA\n·\tPB\n. PC // end"]
)
def test_rule_2_objects_are_objects_side_by_side(text):
    assert str(parse(text)) == "PA · PB · PC"


def test_rule_3_an_object_is_a_figure_a_transformation_or_an_agent():
    figure, transformation, agent = parse("PMap · TMove() · ARobot").nodes
    assert isinstance(figure, FigureNode)
    assert isinstance(transformation, TransformationNode)
    assert isinstance(agent, AgentNode)


def test_rule_4_an_agent_has_an_id_a_state_and_a_scope():
    (agent,) = parse("ARobot#r1<row=3, angle=1.5>(PMap · ARobot#r2)").nodes
    assert (agent.symbol, agent.id) == ("ARobot", "r1")
    assert agent.state == {"row": 3, "angle": 1.5}
    assert str(agent.scope) == "PMap · ARobot#r2()"


def test_rule_5_a_transformation_has_a_scope():
    (outer,) = parse("TMove<dist=2>(TRotate<angle=90>(PRobot) · PMap)").nodes
    assert outer.parameters == {"dist": 2}
    assert [node.symbol for node in outer.scope] == ["TRotate", "PMap"]


def test_rule_6_a_figure_is_one_primitive_or_more():
    assert [node.symbol for node in parse("PA · PA · PB")] == ["PA", "PA", "PB"]


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("PX PX", "PX · PX"),
        ("PX<n=1>PY\nPX // and\n PZ", "PX<n=1> · PY · PX · PZ"),
        ("PX PY · TA(PX PX) · PZ PY", "PX · PY · TA(PX · PX) · PZ · PY"),
        ("AA(PX PY · AB(PX PX)) . PZ", "AA#a1(PX · PY · AB#b1(PX · PX)) · PZ"),
        ("PX<w={PY PZ}> PX", "PX<w={PY · PZ}> · PX"),
    ],
)
def test_rule_6_the_primitives_of_a_figure_need_no_dot(text, printed):
    """p⁺ is a concatenation like `·`: the same string, printed with dots."""
    assert str(parse(text)) == printed
    assert parse(text) == parse(printed)


def test_the_papers_robot_is_a_string_of_the_language():
    """Section 4.2.4, with the agent's state between < and >."""
    w = parse('PMap · ARobot#r1<row=3, column=4, angle=90, speed=0, objective="", action={ε}>')
    assert str(w) == (
        'PMap · ARobot#r1<row=3, column=4, angle=90, speed=0, objective="", action={}>()'
    )


@pytest.mark.parametrize("text", ["", "ε", "  \n ", "// nothing\n", " ε // nothing"])
def test_the_empty_string(text):
    assert parse(text) is EMPTY


def test_nameless_agents_are_numbered_as_they_are_read():
    w = parse("AFox(AFox · ACat) · AFox")
    assert str(w) == "AFox#fox1(AFox#fox2() · ACat#cat1()) · AFox#fox3()"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("AFox · AFox#fox1", "AFox#fox2() · AFox#fox1()"),
        ("AFox#fox1 · AFox", "AFox#fox1() · AFox#fox2()"),
        ("AFox2 · AFox#fox22 · AFox2", "AFox2#fox21() · AFox#fox22() · AFox2#fox23()"),
        ('AFox // #fox1\n · PA<x="#fox1">', 'AFox#fox1() · PA<x="#fox1">'),
    ],
)
def test_a_nameless_agent_never_takes_an_id_that_another_is_given(text, expected):
    assert str(parse(text)) == expected


VALUES = [
    ("1", 1),
    ("-1", -1),
    ("+007", 7),
    ("1.", 1.0),
    (".5", 0.5),
    ("-1.5e-3", -0.0015),
    ("true", True),
    ("false", False),
    ('"a \\"b\\" \\u00e9 é"', 'a "b" é é'),
    ("[]", ()),
    ('[1, [2.5, true], "x"]', (1, (2.5, True), "x")),
]


@pytest.mark.parametrize(("text", "value"), VALUES)
def test_values(text, value):
    (figure,) = parse(f"PA<x={text}>").nodes
    assert figure.values == (value,)
    assert type(figure.values[0]) is type(value)


def test_matrices_and_strings_are_values():
    (figure,) = parse("PA<cells=2x3[0*4 -1 7], reals=1x2r[0.5*2], w={PB · AFox}>").nodes
    cells, reals, w = figure.values
    assert cells.tolist() == [[0, 0, 0], [0, -1, 7]]
    assert reals.tolist() == [[0.5, 0.5]]
    assert str(cells.dtype) == "int16"
    assert str(reals.dtype) == "float64"
    assert str(w) == "PB · AFox#fox1()"


@pytest.mark.parametrize(
    "text",
    [
        "PA<x=1 // one\n, y=2 // two >\n>",
        'PA<x=1m// metres\n, y={PB // a } and a " \n}>',
        "PA // figure\n · // and\n TB // scope\n ( // in\n PC // ) \n ) // end",
        "// first\nPA//last",
        'PA<x="// no comment">',
    ],
)
def test_comments_stand_wherever_blanks_may(text):
    assert "//" not in str(parse(text)).replace('"// no comment"', "")


NOT_IN_THE_LANGUAGE = [
    # text, line, column, problem, expected
    ("PMap(PFox)", 1, 5, "the primitive PMap has no scope", "'·', ')' or the end"),
    ("TMove", 1, 6, "the transformation TMove needs a scope", "'('"),
    ("TMove<dist=1> · PA", 1, 15, "the transformation TMove needs a scope", "'('"),
    ("TMove(PA", 1, 9, "the scope of TMove is not closed (opened at line 1, column 1)", "')'"),
    ("TMove(PA))", 1, 10, "found ')'", "'·' or the end"),
    ("TMove()) · PA", 1, 8, "found ')'", "'·' or the end"),
    ("PA AB", 1, 4, "found 'A'", "'·' or the end"),
    ("PA PB TMove()", 1, 7, "found 'T'", "'·' or the end"),
    ("TMove(PA AB)", 1, 10, "found 'A'", "'·' or ')'"),
    ("TMove(PA) PB", 1, 11, "found 'P'", "'·' or the end"),
    ("AFox PB", 1, 6, "found 'P'", "'·' or the end"),
    ("AFox AFox", 1, 6, "found 'A'", "'·' or the end"),
    ("PA PB(PC)", 1, 6, "the primitive PB has no scope", "'·', ')' or the end"),
    ("PA<x={PB AC}>", 1, 10, "found 'A'", "'·' or '}'"),
    ("PA ·", 1, 5, "found the end", "a symbol of P, T or A"),
    ("· PA", 1, 1, "found '·'", "a symbol of P, T or A"),
    ("PA · · PB", 1, 6, "found '·'", "a symbol of P, T or A"),
    ("XMap", 1, 1, "found 'X'", "a symbol of P, T or A"),
    ("PA ·\n  map", 2, 3, "found 'm'", "a symbol of P, T or A"),
    ("PA#a", 1, 3, "PA cannot have an id", "ids of agents only"),
    ("TA#a()", 1, 3, "TA cannot have an id", "ids of agents only"),
    ("AA#a ·\nAB#a", 2, 1, "duplicate id #a", "a unique id for each agent"),
    ("AA#", 1, 3, "found '#'", "'·' or the end"),
    ("ε · PA", 1, 1, "found 'ε'", "a symbol of P, T or A"),
    ("PA<x>", 1, 5, "found '>'", "'='"),
    ("PA<x=>", 1, 6, "found '>'", 'a number, "text"'),
    ("PA<x=1,>", 1, 8, "found '>'", "a name"),
    ("PA<x=1 2>", 1, 8, "found '2'", "',' or '>'"),
    ("PA<x=1 y=2>", 1, 9, "found '='", "',' or '>'"),
    ("PA<x=1, x=2>", 1, 9, "duplicate name x", "each name once"),
    ("PA<1=2>", 1, 4, "found '1'", "a name or '>'"),
    ("PA<x=1", 1, 7, "found the end", "',' or '>'"),
    ("PA<x=1.5.PB>", 1, 9, "found '.'", "',' or '>'"),
    ("PA<x=[1, 2>", 1, 11, "found '>'", "',' or ']'"),
    ("PA<x=[1,]>", 1, 9, "found ']'", "a number"),
    ('PA<x="a>', 1, 6, "unterminated text", "'\"' at the end of the text"),
    ('PA<x="a\n">', 1, 6, "invalid escape or character in a text", "a JSON string"),
    (r'PA<x="\q">', 1, 6, "invalid escape or character in a text", "a JSON string"),
    (r'PA<x="\ud800">', 1, 6, "invalid escape or character in a text", "a JSON string"),
    ("PA<x=9223372036854775808>", 1, 6, "9223372036854775808 is too large", "64 bits"),
    ("PA<x=1e999>", 1, 6, "1e999 is too large", "a finite number"),
    ("PA<x=nan>", 1, 6, "found 'n'", "a number"),
    ("PA<x=1x2[1]>", 1, 6, "the matrix has 1", "2 cells"),
    ("PA<x=1x1[1.5]>", 1, 6, "invalid cell 1.5", "whole numbers of 16 bits"),
    ("PA<x=1x1[40000]>", 1, 6, "invalid cell 40000", "whole numbers of 16 bits"),
    ("PA<x=1x1[5cm]>", 1, 6, "invalid run '5cm'", "runs such as"),
    ("PA<x=1x1[5*]>", 1, 6, "invalid run '5*'", "runs such as"),
    ("PA<x=1x1[1*9999999999999]>", 1, 6, "invalid run", "runs such as"),
    ("PA<x=99999x99999[0]>", 1, 6, "99999x99999 is too large", "at most 32000000 cells"),
    ("PA<x={PB>", 1, 9, "found '>'", "'·' or '}'"),
    ("PA<x={TB(PC}>", 1, 12, "the scope of TB is not closed", "')'"),
    ("PA<x={PB ·\n ?}>", 2, 2, "found '?'", "a symbol of P, T or A"),
    ("PA<x={", 1, 7, "found the end", "a symbol of P, T or A"),
    ("PA<x=" + "[" * 33, 1, 38, "found '['", "values nested at most 32 deep"),
]


@pytest.mark.parametrize(
    ("text", "line", "column", "problem", "expected"),
    NOT_IN_THE_LANGUAGE,
    ids=[case[0][:24] for case in NOT_IN_THE_LANGUAGE],
)
def test_texts_outside_the_language(text, line, column, problem, expected):
    with pytest.raises(GrammarError) as caught:
        parse(text, "world.txt")
    error = caught.value
    assert (error.line, error.column) == (line, column), str(error)
    assert problem in error.problem
    assert expected in error.expected
    assert str(error).startswith(f"world.txt:{line}:{column}: ")


def test_the_caret_stands_under_what_was_found():
    with pytest.raises(GrammarError) as caught:
        parse("PMap ·\n  TMove<dist=1>(PFox · ? · PMap)")
    assert str(caught.value).splitlines()[1:] == [
        "    TMove<dist=1>(PFox · ? · PMap)",
        "                         ^",
    ]


def test_a_long_line_is_shown_around_the_caret():
    with pytest.raises(GrammarError) as caught:
        parse("PA · " * 100 + "? · " + "PA · " * 100)
    shown, caret = str(caught.value).splitlines()[1:]
    assert len(shown) < 90
    assert shown[caret.index("^")] == "?"
