"""Plants: rewriting rules, brackets as scopes, and events that detect free space."""

from __future__ import annotations

import re
import sys
from typing import Any

import pytest
from example_runs import EXAMPLES, Run, blocks

from minerva_bus import Frame, evolve, visualize
from minerva_bus.grammar.scene import AgentNode, FigureNode, agents, walk

FOLDER = EXAMPLES / "plants"
WORLD = FOLDER / "plants.toml"
sys.path.insert(0, str(FOLDER))

from plants import Bud, Stem, eBody, eCollision, eGrow, ePicture, vocabulary  # noqa: E402  # pyright: ignore[reportMissingImports]

KINDS = [Stem, Bud]


def bud(rule: str, **state: float) -> Any:
    rest = "".join(f", {name}={value}" for name, value in state.items())
    return vocabulary.read(f'ABud#b<rule="{rule}"{rest}>')


def grown(string: Any, times: int = 1) -> Any:
    for number in range(times):
        string = evolve(string, [eGrow()], KINDS, Frame(number, seed=5)).scene
    return string


def shape(string: Any) -> str:
    """The string without parameters."""
    return re.sub(r"<[^<>]*>", "", str(string)).replace("()", "")


@pytest.mark.parametrize(
    ("rule", "becomes"),
    [
        ("X", "ABud#b:1"),
        ("FX", "AStem#b:2(ABud#b:1)"),
        ("F[+X][-X]X", "AStem#b:4(TTurn(ABud#b:1) · TTurn(ABud#b:2) · ABud#b:3)"),
        ("F[+FX]FX", "AStem#b:5(TTurn(AStem#b:2(ABud#b:1)) · AStem#b:4(ABud#b:3))"),
        ("[X][X]", "ABud#b:1 · ABud#b:2"),
        ("F", "AStem#b:1"),
    ],
)
def test_a_bud_becomes_the_result_of_its_rule(rule: str, becomes: str):
    assert shape(grown(bud(rule))) == becomes


def test_turns_are_to_the_left_and_to_the_right_by_about_the_fork():
    turns = [
        node.parameters["angle"]
        for opens, node in walk(grown(bud("[+X][-X]", fork=40)))
        if opens and node.symbol == "TTurn"
    ]
    assert turns == [pytest.approx(40, abs=25), pytest.approx(-40, abs=25)]


def test_heirs_are_smaller_and_weaker_ones_more_so():
    strong, weak = (
        agent.state for agent in agents(grown(bud("[X]Y", length=2, shrink=0.5, orders=6)))
    )
    assert (strong["length"], strong["orders"]) == (1, 5)
    assert (weak["length"], weak["orders"]) == (0.5, 4)


def test_it_goes_on_in_all_buds_at_once_until_their_orders_are_over():
    counts = [
        [agent.symbol for agent in agents(grown(bud("F[+X][-X]", orders=3), times))].count("ABud")
        for times in range(5)
    ]
    assert counts == [1, 2, 4, 8, 0]
    last = [node for _, node in walk(grown(bud("F[+X][-X]", orders=3), 4))]
    assert sum(isinstance(node, FigureNode) for node in last) == 8


def test_a_crowded_bud_becomes_a_flower():
    crowded = evolve(bud("FX"), [eCollision()], KINDS).scene
    assert str(grown(crowded)) == "PFlower"


def test_stems_grow_thicker_and_leaves_fall():
    young, old = (
        shape(visualize(grown(bud("F"), times), [ePicture()], KINDS)) for times in (1, 12)
    )
    assert young.startswith("PSprout")
    assert young.count("PLeaf") == 2
    assert old == "PTrunk · TForward"


def test_capacity_is_shown_with_its_host():
    shown = visualize(grown(bud("F[+X]")), [eBody()], KINDS)
    who = [node.parameters["who"] for _, node in walk(shown) if isinstance(node, FigureNode)]
    assert who == ["b:2", "b:1"]


def test_the_garden_keeps_its_distance_and_is_the_same_in_any_number_of_processes():
    run = Run(WORLD, 14)
    assert Run(WORLD, 14, "plants.processes=3").digests == run.digests
    assert Run(WORLD, 14, 'collisions.ignore=[["*", "*"]]').digests[-1] != run.digests[-1]
    crowded = {
        event.receivers[0] for frame in run.events for event in frame if event.type == "eCollision"
    }
    nodes: list[Any] = [node for opens, node in walk(run.scenes[-1]) if opens]
    alive = {node.id: node for node in nodes if isinstance(node, AgentNode)}
    assert crowded
    assert not {id for id in crowded & alive.keys() if not alive[id].state.get("crowded", True)}
    symbols = [node.symbol for node in nodes]
    assert {"oak", "fir"} & {id.split(":")[0] for id in alive}
    assert symbols.count("PFlower") > 3
    assert symbols.count("ABud") > 20


def test_the_readme_shows_the_files():
    readme = FOLDER / "README.md"
    shown = [*blocks(readme, "python"), *blocks(readme, "mnv")]
    files = [(FOLDER / name).read_text(encoding="utf-8") for name in ("plants.py", "plants.toml")]
    assert len(shown) == 2
    for block in shown:
        assert any(block in file for file in files), block
    (becomes,) = blocks(readme, "text")
    start = re.search(r"ABud#fir<.*?>", files[1])
    assert start is not None
    fir = grown(vocabulary.read(start[0]))
    assert f"({shape(fir)})" in becomes
