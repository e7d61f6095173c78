"""`minerva evolve`: same champion for any distribution; failures and Ctrl-C are handled."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from extensions.study.tests.ponds import pond
from minerva_bus.cli.main import app
from minerva_bus.errors import MinervaError
from minerva_bus.grammar.parser import parse
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.specs import load
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from minerva_study.calibrate_command import _objective
from minerva_study.evaluation import EvaluationCache, Score, run_fitness
from minerva_study.evolve_command import read_fitness
from minerva_study.trial import prepared, run_trial

MARK = "MINERVA_TEST_MARK"


def command(world, *words, fitness="size"):
    return [
        sys.executable, "-m", "minerva_bus", "evolve", str(world), "--json",
        "--fitness", f"pond_of_buds:{fitness}", *words,
    ]  # fmt: skip


def evolve(world, *words, fitness="size"):
    done = subprocess.run(
        command(world, *words, fitness=fitness), cwd=world.parent, capture_output=True, text=True,
    )  # fmt: skip
    return done, json.loads(done.stdout) if done.stdout.startswith("{") else {}


SMALL = ("--population", "4", "--generations", "2", "--mutable", "ABud.vigour=0:1", "--seed", "3")


def test_the_champion_is_the_same_on_any_number_of_workers_over_the_bus_and_alone(tmp_path):
    world = pond(tmp_path)
    over, champion = evolve(world, *SMALL, "--workers", "4")
    alone, other = evolve(world, *SMALL, "--workers", "1", "--in-process", "-o", "best.toml")
    assert (over.returncode, alone.returncode) == (0, 0), over.stderr + alone.stderr
    assert champion == other
    assert champion["best"]["fitness"] > champion["first"]
    assert [row["generation"] for row in champion["generations"]] == [0, 1, 2]
    best = subprocess.run(
        [sys.executable, "-m", "minerva_bus", "run", "best.toml", "--in-process", "--json"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert json.loads(best.stdout)["digest"] == champion["best"]["digest"]


def test_failures_are_named_and_counted_and_plots_are_drawn(tmp_path):
    """Buds over 3 burst, those under -3 take a minute."""
    pytest.importorskip("matplotlib")
    world = pond(tmp_path)
    words = [
        "--population",
        "6",
        "--generations",
        "1",
        "--seed",
        "5",
        "--mutable",
        "ABud.vigour=-3.5:6",
    ]
    words += ["--limit", "3", "--in-process", "--compare-random", "--vigour", "0.25"]
    words += ["--plot", "p.png", "--tree", "t.svg", "-o", "best.mnv", "-o", "all.csv"]
    done, answer = evolve(world, *words)
    assert done.returncode == 0, done.stderr
    errors = {failure["error"] for failure in answer["failed"]}
    assert any("burst" in error for error in errors)
    assert any("took more than 3 s" in error for error in errors)
    assert answer["best"]["fitness"] >= answer["first"] > 2.0
    assert answer["random"] is not None
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "t.svg").read_text()
    assert "ABud#b<vigour=" in (tmp_path / "best.mnv").read_text()
    with (tmp_path / "all.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["generation"] for row in rows] == ["0"] * 6 + ["1"] * 6
    assert all((row["fitness"] == "") is bool(row["error"]) for row in rows)
    # Strings of the random search fail, too, and have no row.
    assert {row["error"] for row in rows} - {""} <= errors
    best = max((row for row in rows if row["fitness"]), key=lambda row: float(row["fitness"]))
    assert best["digest"] == answer["best"]["digest"]


def marked(mark):
    """The ids of the processes with a mark in their environment."""
    folders = []
    for environ in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark.encode() in environ.read_bytes():
                folders.append(environ.parent.name)
        except OSError:
            continue  # It belongs to another user or has just ended.
    return folders


@pytest.mark.timeout(60)
def test_an_interrupt_ends_all_and_reports_the_best_so_far(tmp_path):
    world = pond(tmp_path)
    mark = f"{MARK}={tmp_path}"
    words = ("--population", "3", "--generations", "10000", "--mutable", "ABud.vigour=0:1")
    running = subprocess.Popen(
        command(world, *words, "-o", "best.mnv"), cwd=tmp_path, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "TMPDIR": str(tmp_path), MARK: str(tmp_path)},
    )  # fmt: skip
    assert running.stderr is not None
    assert running.stderr.readline().startswith("generation 0: best ")
    running.send_signal(signal.SIGINT)
    out, _ = running.communicate()
    assert running.returncode == 130
    answer = json.loads(out)
    assert answer["interrupted"]
    assert answer["best"]["fitness"] > 1.0
    assert (tmp_path / "best.mnv").exists()
    while marked(mark):
        time.sleep(0.01)  # Processes whose lifeline is closed are about to exit.


def read(folder):
    return prepared(read_world_file(pond(folder), Overrides()))


@pytest.mark.parametrize(
    ("words", "fitness", "problem"),
    [
        (("--mutable", "ABut"), "size", "did you mean 'ABud'"),
        (("--mutable", "#c.vigour"), "size", "the world's string has no match"),
        (
            ("--mutable", "#b.vigor", "--mutable", "#c"),
            "size",
            "#b.vigor, #c: the world's string has no match",
        ),
        (("-o", "best.txt"), "size", "expected a name that ends in .mnv, .toml, .parquet or .csv"),
        (("-o", "no/best.mnv"), "size", "there is no folder no"),
        (("--plot", "p.doc"), "size", "expected a name that ends in .png"),
        ((), "sise", "did you mean 'size'"),
    ],
)
def test_an_invalid_evolution_is_rejected_in_one_line(tmp_path, words, fitness, problem):
    given = ["evolve", str(pond(tmp_path)), "--fitness", f"pond_of_buds:{fitness}", *words]
    with pytest.raises(MinervaError) as raised:
        app(given, standalone_mode=False)
    assert problem in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_world_without_an_end_or_with_members_elsewhere_is_refused(tmp_path):
    world = pond(tmp_path)
    file = read_world_file(world, Overrides(frames=0))
    with pytest.raises(MinervaError, match="the world has no end; --frames N sets one"):
        prepared(file)
    world.write_text(world.read_text() + "elsewhere = true\n")
    with pytest.raises(MinervaError, match="days runs elsewhere"):
        prepared(read_world_file(world))


def test_a_fitness_that_is_none_fails_the_run(tmp_path):
    file = read(tmp_path)
    with pytest.raises(MinervaError, match="nothing returned nan; expected a finite number"):
        run_fitness(file, load("pond_of_buds:nothing", tmp_path), in_process=True)
    with pytest.raises(MinervaError, match="forgotten returned None; expected a finite number"):
        run_fitness(file, load("pond_of_buds:forgotten", tmp_path), in_process=True)
    with pytest.raises(MinervaError, match=r"wrong raised KeyError\('size'\) at .*buds.py:\d+$"):
        run_fitness(file, load("pond_of_buds:wrong", tmp_path), in_process=True)


def test_the_outcome_has_the_events_and_the_frames(tmp_path):
    outcome = run_trial(read(tmp_path), in_process=True)
    assert (outcome.frames, outcome.events) == (5, {"eDay": 5})
    assert outcome.digest == outcome.scene.digest.hex()


@pytest.mark.parametrize("backwards", [False, True])
def test_the_best_of_equal_strings_does_not_depend_on_the_order_of_runs(backwards):
    scenes = [parse("PA"), parse("PB"), parse("PC")]

    class Runs:
        def evaluate(self, scenes, on_score):
            numbers = range(len(scenes))
            for number in reversed(numbers) if backwards else numbers:
                on_score(number, Score(0.0 if number == 0 else 1.0))

    cache = EvaluationCache(Runs())
    cache(scenes)
    assert cache.best.scene == parse("PB")


@pytest.mark.parametrize("place", ["world", "here"])
def test_functions_of_a_study_are_beside_the_world_file_or_in_the_current_folder(
    tmp_path, place, monkeypatch
):
    for name in ("world", "here"):
        (tmp_path / name).mkdir()
    module = f"measured_{place}"
    (tmp_path / place / f"{module}.py").write_text("def score(run):\n    return 1.0\n")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path / "here")
    file = replace(read_world_file(find_world("meadow")), path=tmp_path / "world" / "w.toml")
    assert read_fitness(f"{module}:score", file).__name__ == "score"
    assert _objective(f"{module}:score", tmp_path / "world").__name__ == "score"
