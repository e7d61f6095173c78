"""The meadow: its agents on their own, the world in one process, and the world on the bus."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from minerva_bus import EMPTY, Event, Frame, Scene, World, evolve, visualize
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.scene import AgentNode, agents
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "worlds" / "minerva_worlds" / "meadow"
WORLD = FOLDER / "meadow.toml"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]

sys.path.insert(0, str(FOLDER))

from meadow import (  # noqa: E402  # pyright: ignore[reportMissingImports]
    Fox,
    Meadow,
    Rabbit,
    eAlarm,
    eBite,
    eGrass,
    eGraze,
    eHowl,
    eMeal,
    ePicture,
    eProwl,
    eRain,
    eRustle,
    eStep,
    vocabulary,
)

KINDS = [Meadow, Rabbit, Fox]


def state(scene: Scene, agent: str) -> dict[str, object]:
    return dict(next(candidate for candidate in agents(scene) if candidate.id == agent).state)


# --- agents without a bus -------------------------------------------------------------------------


def test_a_bite_kills_and_feeds():
    rabbit = vocabulary.read("ARabbit#r<x=1, y=1>")
    evolved = evolve(rabbit, [eBite(sender="f")], [Rabbit])
    assert evolved.scene == EMPTY
    assert evolved.emitted == {"r": (eMeal(8.0, sender="r", receivers=["f"]),)}


def test_two_bites_feed_one_fox():
    rabbit = vocabulary.read("ARabbit#r<x=1, y=1>")
    evolved = evolve(rabbit, [eBite(sender="f"), eBite(sender="g")], [Rabbit])
    assert [event.receivers for event in evolved.emitted["r"]] == [("f",)]


def test_the_hungry_starve():
    scene = vocabulary.read("ARabbit#r<x=1, y=1, energy=0.05> · AFox#f<x=9, y=9, energy=1>")
    assert evolve(scene, [eStep()], KINDS).scene == EMPTY


def test_a_well_fed_rabbit_has_young():
    rabbit = vocabulary.read("ARabbit#r<x=1, y=1, energy=20>")
    scene = evolve(rabbit, [eStep()], [Rabbit]).scene
    assert [agent.id for agent in agents(scene)] == ["r", "r:1"]
    assert state(scene, "r")["births"] == 1
    assert state(scene, "r")["energy"] == state(scene, "r:1")["energy"] == pytest.approx(9.97)


def test_the_meadow_answers_the_grazing_rabbit():
    meadow = vocabulary.read("AMeadow#m")
    evolved = evolve(meadow, [eGraze(3.2, 4.9, sender="r")], [Meadow])
    (answer,) = evolved.emitted["m"]
    assert (answer.amount, answer.receivers) == (2.0, ("r",))
    grass = state(evolved.scene, "m")["grass"]
    assert grass[6, 9] == 0  # pyright: ignore[reportIndexIssue]


def test_rain_lets_grass_grow_to_its_height_and_no_higher():
    scene = vocabulary.read("AMeadow#m")
    for number in range(9):
        scene = evolve(scene, [eRain(1.0)], [Meadow], Frame(number)).scene
    assert (state(scene, "m")["grass"] == 7).all()  # pyright: ignore[reportAttributeAccessIssue]


def test_only_nearby_rabbits_are_warned_and_only_once():
    scene = vocabulary.read("ARabbit#near<x=1, y=1> · ARabbit#far<x=20, y=1>")
    prowl = eProwl(2.0, 1.0, condition="x > -1 and x < 5 and y > -2 and y < 4")
    evolved = evolve(scene, [prowl, prowl], [Rabbit])
    assert [event.type for event in evolved.emitted["near"]] == ["eAlarm"]
    assert set(evolved.emitted) == {"near"}
    warned = evolve(evolved.scene, evolved.emitted["near"], [Rabbit]).scene
    assert (state(warned, "near")["fear"], state(warned, "far")["fear"]) == (10, 0)


def test_a_warned_rabbit_keeps_still():
    scene = vocabulary.read("ARabbit#r<x=1, y=1>")
    scene = evolve(scene, [eAlarm(1.0, 1.0)], [Rabbit]).scene
    for number in range(10):
        evolved = evolve(scene, [eStep()], [Rabbit], Frame(number))
        assert not evolved.emitted
        scene = evolved.scene
    assert state(scene, "r")["fear"] == 0


def test_a_fox_follows_the_nearest_and_bites_when_it_is_there():
    fox = vocabulary.read("AFox#f<x=5, y=5>")
    noises = [eRustle(7.0, 5.0, sender="far"), eRustle(5.0, 5.5, sender="near")]
    evolved = evolve(fox, [*noises, eStep()], [Fox], Frame(1))
    assert state(evolved.scene, "f")["y"] == pytest.approx(5.35)
    bites = [event for event in evolved.emitted["f"] if event.type == "eBite"]
    assert bites == [eBite(sender="f", receivers=["near"])]


def test_a_fox_with_company_does_not_breed():
    fox = vocabulary.read("AFox#f<x=5, y=5, energy=30>")
    alone = evolve(fox, [eStep()], [Fox]).scene
    in_company = evolve(fox, [eHowl(6.0, 5.0, sender="g"), eStep()], [Fox]).scene
    assert (len(alone), len(in_company)) == (2, 1)


def test_a_picture_holds_no_agents():
    scene = vocabulary.read("AMeadow#m · ARabbit#r<x=1, y=1> · AFox#f<x=2, y=2>")
    shown = visualize(scene, [ePicture()], KINDS)
    assert [node.symbol for node in shown] == ["PGrass", "TPlace", "TPlace"]
    assert not list(agents(shown))


# --- the world in one process ---------------------------------------------------------------------


class Run:
    """An in-process run of the world file, frame by frame."""

    def __init__(self, seed: int, *settings: str) -> None:
        overrides = Overrides(seed=seed, settings=settings)
        file = read_world_file(WORLD, overrides)
        self.algorithm = FrameAlgorithm(file.world)
        self.heard: Counter[str] = Counter()
        participants = [process.make_member() for process in file.processes]
        self._runner = InProcessRunner(self.algorithm, participants, self._watch)
        self._runner.start()

    def _watch(self, instruction: s.Instruction) -> None:
        if isinstance(instruction, s.FrameDone):
            events: tuple[Event, ...] = instruction.record.events
            self.heard.update(event.type for event in events)

    def frames(self, count: int) -> Iterator[dict[str, int]]:
        """Yields the number of agents of each kind after each frame."""
        for _ in range(count):
            self._runner.handle(s.Begin())
            nodes = self.algorithm.scene.nodes
            yield Counter(node.symbol for node in nodes if isinstance(node, AgentNode))

    @property
    def digest(self) -> bytes:
        return self.algorithm.scene.digest


def test_they_live_die_and_talk():
    run = Run(7)
    for population in run.frames(300):
        assert 0 < population["ARabbit"] < 300
        assert 0 < population["AFox"] < 20
    ids = {agent.id for agent in agents(run.algorithm.scene)}
    assert any(":" in id for id in ids), "nobody was born"
    assert not {"r1", "r2", "r3", "r4", "r5", "r6"} <= ids, "nobody died"
    said = {"eRustle", "eProwl", "eAlarm", "eHowl", "eBite", "eMeal", "eGraze", "eGrass", "eRain"}
    assert said <= set(run.heard)
    assert sum(run.heard.values()) < 300 * 60


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", range(3))
def test_no_kind_dies_out_or_overruns_the_meadow(seed: int):
    for population in Run(seed).frames(1000):
        assert 0 < population["ARabbit"] < 300
        assert 0 < population["AFox"] < 20


def test_one_host_and_three_make_the_same_world():
    single, three = Run(3, "rabbits.processes=1"), Run(3, "rabbits.processes=3")
    for _ in zip(single.frames(150), three.frames(150), strict=True):
        assert single.digest == three.digest


def test_another_seed_is_another_world():
    digests: set[bytes] = set()
    for seed in (1, 2):
        run = Run(seed)
        list(run.frames(20))
        digests.add(run.digest)
    assert len(digests) == 2


# --- the world on the bus -------------------------------------------------------------------------


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the example's folder, isolated from other worlds of this machine."""
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "run"))
    packages = [str(ROOT / name) for name in ("", "services", "agents")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(packages))
    return Path(shutil.copytree(FOLDER, tmp_path / "meadow"))


def minerva(here: Path, words: list[str]) -> str:
    """The standard output of a command."""
    done = subprocess.run([*MINERVA, *words], cwd=here, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


# --- the README -----------------------------------------------------------------------------------


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("block", [*blocks("python"), *blocks("toml"), *blocks("mnv")])
def test_the_readme_shows_the_files(block: str):
    files = [FOLDER / "meadow.py", WORLD, Path(__file__)]
    assert any(block in file.read_text(encoding="utf-8") for file in files)


def commands(block: str) -> list[list[str]]:
    """The commands of a block, without comments and the program's name."""
    return [shlex.split(line, comments=True)[1:] for line in block.splitlines()]


def test_the_digests_that_the_readme_promises(here: Path):
    _, runs, _ = map(commands, blocks("sh"))
    assert len({json.loads(minerva(here, [*run, "--json"]))["digest"] for run in runs}) == 1


@pytest.mark.parametrize(
    "event", [eBite(), eGraze(-1.0, 2.0), eGraze(2.0, 1e300), eRustle(2.0, 13.0)]
)
def test_what_people_send_in_the_name_of_animals_has_no_receiver_for_an_answer(event):
    with World.load(WORLD).start(seed=7) as live:
        live.step(2)
        live.publish(event)
        live.step(3)
        assert live.frame == 5


@pytest.mark.parametrize("amount", [1e308, -1e308])
def test_animals_stay_few_whatever_people_feed_them(amount: float):
    with World.load(WORLD).start(seed=7) as live:
        live.step(2)
        for event in (eGrass(amount), eMeal(amount)):
            live.publish(event)
            live.publish(event)
        live.step(12)
        assert len([*agents(live.scene)]) < 2_000
