"""The evolution world: creatures hatch and eat, and a study reproduces the README's result."""

import json
import re
import subprocess
import sys
from pathlib import Path

from minerva_bus.launch.specs import load
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.world.context import stream
from minerva_study.mutation.mutable import parse_targets
from minerva_study.mutation.mutator import Mutator
from minerva_study.trial import prepared, run_trial

FOLDER = Path(__file__).resolve().parents[3] / "worlds" / "minerva_worlds" / "evolution"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
FILE = prepared(read_world_file(FOLDER / "forager.toml", Overrides()))


def test_six_creatures_hatch_of_the_egg_and_eat():
    outcome = run_trial(FILE, in_process=True)
    brood = [node for node in outcome.scene if node.symbol == "ACreature"]
    gone = 48 - sum(node.symbol == "ABerry" for node in outcome.scene)
    assert len(brood) == 6
    assert {str(node.scope) for node in brood} == {str(FILE.world.scene.nodes[1].scope)}
    assert sum(node.state["eaten"] for node in brood) == outcome.events.get("eMeal", 0)
    assert gone in (outcome.events.get("eMeal", 0), outcome.events.get("eMeal", 0) + 1)
    assert load("forager:berries", FOLDER)(outcome) == outcome.events.get("eMeal", 0) - 2


def test_the_command_of_the_readme_changes_bodies_and_nothing_else():
    (command,) = re.findall(r"^minerva evolve (.*?[^\\])$", README, re.M | re.S)
    targets = re.findall(r"--mutable (\S+)", command)
    mutator = Mutator(parse_targets(targets, FILE.world.vocabulary))
    string = FILE.world.scene
    for n in range(30):
        string = mutator.mutated(string, stream(1, "test", n)).scene
    assert [str(node) for node in string.nodes[2:]] == [
        str(node) for node in FILE.world.scene.nodes[2:]
    ]
    assert string.nodes[1].scope != FILE.world.scene.nodes[1].scope


def test_it_evolves(tmp_path):
    words = "--fitness forager:berries --mutable PEye --mutable PEye.left=-2:2 --frames 15"
    words += " --mutable AEgg.speed=0:0.4 --population 4 --generations 1 --in-process --json"
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus", "evolve", "forager.toml", *words.split()],
        cwd=FOLDER, capture_output=True, text=True,
    )  # fmt: skip
    answer = json.loads(done.stdout)
    assert answer["best"]["fitness"] >= answer["first"]
    assert not answer["failed"]
