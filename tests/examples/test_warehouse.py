"""The warehouse: its agents on their own, the complete world, and the claims of its README."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from minerva_bus import Frame, evolve, visualize
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from minerva_messages import eMessage

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "worlds" / "minerva_worlds" / "warehouse"
WORLD = FOLDER / "warehouse.toml"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]

sys.path.insert(0, str(FOLDER))

from warehouse import (  # noqa: E402  # pyright: ignore[reportMissingImports]
    DOCKS,
    SHELVES,
    Carrier,
    Manager,
    eOrder,
    ePicture,
    eStep,
    read_job,
    route,
    vocabulary,
    way,
)

KINDS = [Manager, Carrier]
JOB = 'PJob<source="A5", target="south">'


def cfp(content=JOB, **more):
    more = {"protocol": "fipa-contract-net", "conversation_id": "manager/1"} | more
    return eMessage("cfp", content, sender="manager", receivers=["c"], **more)


def answer(carrier, message):
    evolved = evolve(vocabulary.read(carrier), [message], KINDS)
    ((said,),) = evolved.emitted.values()
    return said.performative, said.content


# --- agents without a bus -------------------------------------------------------------------------


def test_a_carrier_bids_what_the_way_costs():
    there, back = SHELVES["A5"], DOCKS["south"]
    cost = way(route(1.0, 2.5, there)) + way(route(*there, back))
    assert answer("ACarrier#c<x=1, y=2.5, home=2.5>", cfp()) == ("propose", f"{cost:.1f}")
    tired = answer("ACarrier#c<x=1, y=2.5, home=2.5, battery=80>", cfp())
    assert tired == ("propose", f"{cost / 0.8:.1f}")


def test_a_carrier_refuses_a_task_from_which_it_could_not_return():
    answered = answer("ACarrier#c<x=1, y=2.5, home=2.5, battery=50>", cfp())
    assert answered == ("refuse", "battery low")


@pytest.mark.parametrize(
    "content", ["", "the moon", 'PJob<source="Z9", target="south">', "PBox<1>"]
)
def test_a_job_that_is_none_is_not_understood(content):
    assert read_job(content) is None
    assert answer("ACarrier#c<x=1, y=2.5, home=2.5>", cfp(content))[0] == "not-understood"


def test_a_bid_that_is_no_number_is_not_understood():
    manager = vocabulary.read('AManager#manager<carriers=["c"]>')
    manager = evolve(manager, [eOrder("A5", "south"), eStep()], KINDS).scene
    bid = {"protocol": "fipa-contract-net", "conversation_id": "manager/1", "sender": "c"}
    done = evolve(manager, [eMessage("propose", "cheap", **bid), eStep()], KINDS, Frame(1))
    assert [message.performative for message in done.emitted["manager"]] == ["not-understood"]


def test_an_order_for_what_is_not_there_is_passed_over():
    manager = vocabulary.read("AManager#manager")
    assert evolve(manager, [eOrder("A5", "moon")], KINDS).scene == manager


def test_a_picture_has_no_agents():
    scene = vocabulary.read("AManager#manager · ACarrier#c<x=1, y=2.5, home=2.5, loaded=true>")
    assert not list(agents(visualize(scene, [ePicture()], KINDS)))


# --- the world ------------------------------------------------------------------------------------


class Run:
    """An in-process run of the world file, frame by frame."""

    def __init__(self, frames, *settings, seed=None, **options):
        overrides = Overrides(seed=seed, frames=frames, settings=settings, options=options)
        file = read_world_file(WORLD, overrides)
        self.algorithm = FrameAlgorithm(file.world)
        self.messages = []
        participants = [process.make_member() for process in file.processes]
        runner = InProcessRunner(self.algorithm, participants, self._watch)
        runner.start()
        while runner.ended is None:
            runner.handle(s.Begin())

    def _watch(self, instruction):
        if isinstance(instruction, s.FrameDone):
            events = instruction.record.events
            self.messages += [event for event in events if event.type == "eMessage"]

    def state(self, who):
        return next(dict(agent.state) for agent in agents(self.algorithm.scene) if agent.id == who)


def test_transports_are_called_bid_for_and_done():
    run = Run(400)
    manager = run.state("manager")
    assert manager["done"] >= 5
    acts = {message.performative for message in run.messages}
    assert {"cfp", "propose", "refuse", "accept-proposal", "reject-proposal", "inform"} <= acts
    assert "not-understood" not in acts
    done = sum(message.performative == "inform" for message in run.messages)
    assert done == manager["done"]
    for agent in agents(run.algorithm.scene):
        assert agent.id == "manager" or 0 < agent.state["battery"] <= 100


def test_a_carrier_serves_one_manager():
    run, under_way = Run(400), set()
    for message in run.messages:
        if message.performative == "accept-proposal":
            assert not set(message.receivers) & under_way
            under_way |= set(message.receivers)
        elif message.performative in ("inform", "failure"):
            under_way.remove(message.sender)


def test_one_process_and_three_make_the_same_world():
    single, three = (Run(150, f"carriers.processes={n}").algorithm.scene.digest for n in (1, 3))
    assert single == three
    assert Run(150, seed=9).algorithm.scene.digest != single


# --- the README -----------------------------------------------------------------------------------


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("block", blocks("python"))
def test_the_readme_shows_the_files(block):
    assert block in (FOLDER / "warehouse.py").read_text(encoding="utf-8")


def test_the_commands_of_the_readme(tmp_path, monkeypatch):
    pytest.importorskip("mcap")
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "run"))
    packages = [str(ROOT / name) for name in ("", "services", "agents")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(packages))
    here = shutil.copytree(FOLDER, tmp_path / "warehouse")
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    runs = [line for line in lines if "--carriers" in line]
    talks = [line for line in lines if "run.mcap" in line]

    def minerva(line, *more):
        words = [*shlex.split(line)[1:], *more]
        done = subprocess.run([*MINERVA, *words], cwd=here, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    fewer = [line.replace("--frames 300", "--frames 60") for line in runs]
    digests = {json.loads(minerva(line, "--json"))["digest"] for line in fewer}
    assert len(digests) == 1
    for line in talks:
        minerva(line.replace("--frames 600", "--frames 125"))
    drawn = (here / "conversation.svg").read_text(encoding="utf-8")
    for shown in ("cfp: PJob", "refuse: busy", "propose: ", "reject-proposal", "inform: PJob"):
        assert shown.replace("<", "&lt;") in drawn
