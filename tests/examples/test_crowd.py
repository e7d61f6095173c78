"""The crowd: a person, the signs, and a building that empties."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from example_runs import EXAMPLES, Run, blocks

from minerva_bus import EMPTY, Frame, MinervaError, evolve
from minerva_bus.grammar.scene import agents

FOLDER = EXAMPLES / "crowd"
WORLD = FOLDER / "crowd.toml"
sys.path.insert(0, str(FOLDER))

from crowd import (  # noqa: E402  # pyright: ignore[reportMissingImports]
    CELL,
    RADIUS,
    Building,
    Person,
    eCollision,
    eOut,
    eSign,
    scene,
    two_steps_ahead,
    vocabulary,
)

SMALL = """\
##########
#   #    #
#        E
#   #    E
##########
"""


def person(**state: float) -> Any:
    written = ", ".join(f"{name}={value}" for name, value in {"x": 2, "y": 2, **state}.items())
    return vocabulary.read(f"APerson#p<{written}>")


def after(string: Any, *events: Any) -> dict[str, Any]:
    (agent,) = agents(evolve(string, events, [Person, Building], Frame(3, 0.05)).scene)
    return dict(agent.state)


def test_a_robot_that_hits_a_wall_moves_back_and_stops():
    state = after(person(vx=1.0, vy=0.5), eCollision("", "PWalls", -1.0, 0.0, 0.1))
    assert (state["x"], state["y"], state["vx"], state["vy"]) == (1.9, 2, 0, 0.5)


def test_two_colliding_agents_move_back_half_the_overlap_each():
    state = after(person(vy=-1.0), eCollision("q", "PBody", 0.0, 1.0, 0.2))
    assert (state["y"], state["vy"]) == (2.1, 0)
    assert after(person(vy=2.0), eCollision("q", "PBody", 0.0, 1.0, 0.2))["vy"] == 2


def test_a_person_at_an_exit_has_left():
    evolved = evolve(person(), [eCollision("", "PExit", -1.0, 0.0, 0.1)], [Person])
    assert evolved.scene == EMPTY
    assert [event.type for event in evolved.emitted["p"]] == ["eOut"]


def test_people_go_where_signs_point():
    state = after(person(), eSign(0.0, 1.0))
    assert state["x"] == 2
    assert state["y"] == pytest.approx(2 + 0.3 * 1.3 * 0.1)


def test_the_building_reports_the_last_exit():
    building = vocabulary.read("ABuilding#b<inside=2>")
    evolved = evolve(building, [eOut()], [Building], Frame(3, 0.05))
    assert not evolved.emitted
    (empty,) = evolve(evolved.scene, [eOut()], [Building], Frame(4, 0.05)).emitted["b"]
    assert (empty.type, empty.seconds) == ("eEmpty", pytest.approx(0.2))


def test_signs_lead_round_corners_to_the_nearest_exit():
    free = np.ones((5, 5), bool)
    free[2, 1:] = False  # a wall with a gap at y = 0
    exits = np.zeros((5, 5), bool)
    exits[4, 4] = True
    ahead = two_steps_ahead(free, exits)
    cell, steps = (0, 4), [(0, 4)]
    while not exits[cell] and len(steps) < 12:
        cell = tuple((ahead[cell] / CELL).astype(int).tolist())
        steps.append(cell)
    assert cell == (4, 4)
    assert all(free[step] for step in steps)
    assert (2, 0) in steps or (1, 0) in steps


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "plan.txt"
    path.write_text(SMALL, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def run(plan: Path) -> Run:
    return Run(WORLD, 0, plan=str(plan), people="12")


def people(string: Any) -> list[dict[str, Any]]:
    return [dict(agent.state) for agent in agents(string) if agent.symbol == "APerson"]


def test_all_get_out_and_the_world_ends(run: Run):
    assert [len(people(run.scenes[0])), len(people(run.scenes[-1]))] == [12, 0]
    assert 40 < len(run.scenes) < 600
    (building,) = agents(run.scenes[-1])
    assert building.state == {"inside": 0, "out": 12}
    assert len([event for frame in run.events for event in frame if event.type == "eOut"]) == 12


def test_they_do_not_walk_through_walls_and_hardly_into_each_other(run: Run):
    walls = np.array([list(line) for line in reversed(SMALL.splitlines())]).T == "#"
    deepest: list[float] = []
    for string in run.scenes:
        places = np.array([(person["x"], person["y"]) for person in people(string)]).reshape(-1, 2)
        cells = (places / CELL).astype(int)
        assert not walls[cells[:, 0], cells[:, 1]].any()
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        deepest.append(float((2 * RADIUS - apart - 9 * np.eye(len(places))).max(initial=-1)))
    assert max(deepest) < RADIUS
    assert np.median(deepest) < RADIUS / 2


def test_in_one_process_and_in_three_it_is_the_same(run: Run, plan: Path):
    settings = ("people.processes=3",)
    assert Run(WORLD, 0, *settings, plan=str(plan), people="12").digests == run.digests


def test_a_building_without_an_exit_and_too_many_people_are_refused(plan: Path, tmp_path: Path):
    closed = tmp_path / "closed.txt"
    closed.write_text(SMALL.replace("E", "#"), encoding="utf-8")
    with pytest.raises(MinervaError, match="has no exit"):
        scene({"plan": str(closed), "people": 3, "crowd": 1})
    with pytest.raises(MinervaError, match="99 people; expected 1 to 22"):
        scene({"plan": str(plan), "people": 99, "crowd": 1})


@pytest.mark.parametrize("block", blocks(FOLDER / "README.md", "python"))
def test_the_readme_shows_the_file(block: str):
    assert block in (FOLDER / "crowd.py").read_text(encoding="utf-8")
