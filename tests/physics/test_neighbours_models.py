"""Worlds of agents that perceive their neighbours: one string for all forms and layouts."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from benchmarks.models import flock, schelling
from minerva_bus import Agent, Scene
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.world.event_collection import Priority
from minerva_services.physics.neighbours.search import near
from minerva_services.physics.neighbours.spots import Lattice
from tests.one_process import run_file, run_world

ROOT = Path(__file__).resolve().parents[2]
MODELS = pytest.mark.parametrize("model", [flock, schelling], ids=lambda model: model.NAME)


def run(
    model: ModuleType,
    agents: int,
    steps: int,
    hosts: int = 1,
    kinds: list[type[Agent]] | None = None,
) -> tuple[list[str], Scene]:
    """The digests of all frames, and the last string."""
    kinds = model.kinds if kinds is None else kinds
    members = [Member(name, make()) for name, make in model.services(agents).items()]
    members += [Member(f"host-{number}", agents=kinds) for number in range(hosts)]
    names = frozenset(member.name for member in members)
    world = WorldSpec(
        "test",
        model.scene(agents, 5),
        model.vocabulary,
        seed=5,
        frames=steps * model.CYCLE + 1,
        order=Priority(model.order),
        expected=names,
    )
    digests = list[str]()
    runner = run_world(world, members, lambda done, scene: digests.append(scene.digest.hex()))
    return digests, runner.algorithm.scene


@MODELS
def test_two_hosts_make_the_same_string_as_one(model: ModuleType) -> None:
    digests, _ = run(model, 120, 6)
    assert len(set(digests)) > 6
    assert run(model, 120, 6, hosts=2)[0] == digests


@MODELS
def test_written_for_one_it_is_the_same_string(model: ModuleType) -> None:
    assert run(model, 120, 6, kinds=model.plain_kinds)[0] == run(model, 120, 6)[0]


def local_order(scene: Scene) -> tuple[float, float]:
    """The mean cosine between the directions of neighbours, and their mean number."""
    x, y, vx, vy = (scene.pieces[0].column(name) for name in ("x", "y", "vx", "vy"))
    pairs = near(x, y, flock.VISION, (flock.side(len(x)),) * 2)
    length = np.maximum(np.hypot(vx, vy), 1e-12)
    ux, uy = vx / length, vy / length
    cosines = ux[pairs.first] * ux[pairs.second] + uy[pairs.first] * uy[pairs.second]
    return float(cosines.mean()), 2 * len(pairs.first) / len(x)


def similar(scene: Scene) -> tuple[float, float]:
    """The shares of similar neighbours, and of happy residents."""
    parts = [p for p in scene.pieces if p.symbol == "AResident"]
    x, y, kind = (np.concatenate([p.column(name) for p in parts]) for name in ("x", "y", "colour"))
    width = schelling.side(len(x))
    lattice = Lattice(width, width, schelling.RADIUS, "moore", periodic=False)
    number, same, _ = lattice.compared(x * width + y, kind)
    share = same / np.maximum(number, 1)
    return float(share[number > 0].mean()), float((share >= schelling.HOMOPHILY).mean())


def test_a_flock_becomes_ordered() -> None:
    before = local_order(flock.scene(400, 5))
    after = local_order(run(flock, 400, 60)[1])
    assert abs(before[0]) < 0.1
    assert after[0] > 0.15
    assert after[1] > before[1] + 1


def test_a_town_segregates_and_keeps_its_agents() -> None:
    before, after = schelling.scene(400, 5), run(schelling, 400, 15)[1]
    share, happy = similar(after)
    assert similar(before)[0] < 0.55
    assert share > 0.7
    assert happy > 0.95
    cells = [p.column("x") * schelling.side(400) + p.column("y") for p in after.pieces]
    assert sorted(np.concatenate(cells).tolist()) == list(range(schelling.side(400) ** 2))


def test_a_step_of_boids_is_that_of_reynolds_rules_by_brute_force() -> None:
    columns = {name: flock.scene(60, 5).pieces[0].column(name) for name in ("x", "y", "vx", "vy")}
    place = np.stack((columns["x"], columns["y"]), axis=1)
    heading = np.stack((columns["vx"], columns["vy"]), axis=1)
    size = flock.side(60)
    expected = heading.copy()
    for number in range(60):
        delta = (place - place[number] + size / 2) % size - size / 2
        distance = np.hypot(*delta.T)
        near = (distance <= flock.VISION) & (np.arange(60) != number)
        if near.any():
            close = near & (distance < flock.SEPARATION)
            turn = flock.COHERE * delta[near].sum(0) - flock.SEPARATE * delta[close].sum(0)
            turn += flock.MATCH * heading[near].sum(0)
            expected[number] += turn / near.sum()
            expected[number] /= np.hypot(*expected[number])
    after = run(flock, 60, 1)[1].pieces[0]
    np.testing.assert_allclose(after.column("vx"), expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(after.column("vy"), expected[:, 1], atol=1e-12)
    np.testing.assert_allclose(after.column("x"), place[:, 0] + expected[:, 0], atol=1e-12)


def test_the_flock_of_the_examples_is_the_same_in_any_number_of_processes() -> None:
    digests = set()
    for processes in (1, 3):
        settings = (f"birds.processes={processes}",)
        overrides = Overrides(frames=30, options={"birds": "90"}, settings=settings)
        file = read_world_file(
            ROOT / "worlds" / "minerva_worlds" / "flock" / "flock.toml", overrides
        )
        assert len(file.processes) == processes + 2
        algorithm = run_file(file).algorithm
        assert algorithm.frame == 30
        digests.add(algorithm.scene.digest)
    assert len(digests) == 1
