"""The crossing: norms prevent crashes, and the string is the same in every layout."""

import json
import shutil
import sys
from pathlib import Path

import pytest

from minerva_bus import Frame, evolve
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from tests.one_process import run_file
from tests.runtime.running import here, minerva, summary

FOLDER = Path(__file__).parents[2] / "worlds" / "minerva_worlds" / "traffic"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
WORLD = (FOLDER / "traffic.toml").read_text(encoding="utf-8")

sys.path.insert(0, str(FOLDER))

from traffic import MOST_FINED, Car, eFine, eHonk, eLight, vocabulary  # noqa: E402


def lived(norms, frames=400):
    """An in-process run: its metrics, and the states of the drivers at its end."""
    overrides = Overrides(options={"norms": norms}, frames=frames)
    file = read_world_file(FOLDER / "traffic.toml", overrides)
    runner = run_file(file)
    drivers = [agent for agent in agents(runner.algorithm.scene) if "c" in agent.id]
    return runner.ended.figures, [driver.state for driver in drivers]


def test_norms_make_the_difference():
    norms, drivers = lived("true")
    free, others = lived("false")
    assert norms["crashes"] == 0 < 3 <= free["crashes"]
    assert min(norms["norm_red_light"], norms["norm_quiet"]) > 20
    assert not {name for name in free if name.startswith("norm_")}
    paid = sum(driver["fined"] for driver in drivers)
    assert paid == 40 * norms["norm_speed_limit"] > 0
    assert max(driver["wish"] for driver in drivers) <= 12.5 < max(d["wish"] for d in others)


@pytest.mark.parametrize("care", [0.0, 0.25, 1.0])
def test_a_driver_notices_the_light_as_often_as_he_takes_care(care):
    car = vocabulary.read(f'ACar#c<lane="east", axis="x", s=-40, care={care}>')
    noticed = [
        evolve(car, [eLight("red", "green")], [Car], Frame(t, 0.1, 3)).scene.nodes[0].state["stop"]
        for t in range(200)
    ]
    assert abs(sum(noticed) / 200 - care) < 0.1


def test_a_horn_reaches_only_cars_ahead_in_the_lane():
    scene = vocabulary.read(
        'ACar#ahead<lane="east", axis="x", s=-8, stop=true>'
        ' · ACar#behind<lane="east", axis="x", s=-30, stop=true>'
        ' · ACar#there<lane="west", axis="x", s=-8, stop=true>'
    )
    heard = set()
    for t in range(40):
        now = evolve(scene, [eHonk(condition='lane == "east" and s > -20.0')], [Car], Frame(t))
        heard |= {agent.id for agent in agents(now.scene) if not agent.state["stop"]}
    assert heard == {"ahead"}


def test_it_is_the_same_everywhere_and_goes_on_from_its_record(tmp_path):
    folder = Path(shutil.copytree(FOLDER, tmp_path / "traffic"))
    words = ("run", "traffic.toml", "--rate", 0, "--json")
    alone = (*words, "--in-process")
    whole = summary(here(folder, *alone, "--frames", 150, "--record", "whole.mcap"))
    assert whole["norm_red_light"] >= 3
    ended = summary(minerva(folder, *words, "--frames", 150, "--name", f"traffic-{tmp_path.name}"))
    same = ("digest", "crashes", "passed", "norm_red_light", "norm_speed_limit")
    assert [ended[name] for name in same] == [whole[name] for name in same]
    summary(here(folder, *alone, "--frames", 70, "--record", "cut.mcap"))
    resumed = ("run", "--resume", "cut.mcap", "--in-process", "--json")
    on = summary(here(folder, *resumed, "--frames", 150, "--record", "on.mcap"))
    assert [on[name] for name in same] == [whole[name] for name in same]
    again = here(folder, "replay", "on.mcap", "--recompute")
    assert again.stdout == "the same: all 150 recomputed frames match the record\n"
    info = json.loads(here(folder, "info", "on.mcap", "--json").stdout)
    assert info["broken"]["red_light"] == whole["norm_red_light"]
    assert "red_light" in here(folder, "info", "on.mcap").stdout
    other = here(folder, *resumed, "--frames", 150, "--norms", "false")
    assert other.returncode
    assert "its norms are not those of the world file" in other.stderr


def test_the_readme_has_the_norms_of_the_world():
    for block in README.split("```toml\n")[1:]:
        for line in block.split("\n```")[0].splitlines():
            name = line.split(" = ")[0]
            assert any(entry.startswith(line) for entry in WORLD.splitlines()), name


@pytest.mark.parametrize(("amount", "fined"), [(2**62, MOST_FINED), (-(2**62), 0)])
def test_a_driver_pays_a_limited_fine_whatever_people_send(amount: int, fined: int):
    car = vocabulary.read('ACar#c<lane="east", axis="x", s=-40>')
    for t in range(3):
        car = evolve(car, [eFine(amount, "speed_limit")], [Car], Frame(t, 0.1, 3)).scene
    assert car.nodes[0].state["fined"] == fined
