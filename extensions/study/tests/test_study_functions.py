"""Sweeps and evolutions as functions."""

import os
import signal

import numpy as np
import pytest

from minerva_bus import (
    Agent,
    MinervaError,
    World,
    count,
    each,
    on,
    record,
    run,
)
from minerva_bus.errors import MisuseError
from minerva_study import branch, evolve_strings, sweep
from tests.api.frogs import Frog, eTick, pond
from tests.odd_arguments import check_refusals


def frogs(options):
    return Frog.many("f", options["n"])


def many(**settings):
    return World(
        frogs, agents=[Frog], services=[each(eTick)], options={"n": 2}, name="many", **settings
    )


def test_a_sweep_returns_one_table():
    curves = sweep(
        many(), {"n": [2, 5]}, seeds=3, frames=4, collect={"frogs": count(Frog), "x": Frog.x.mean()},
        quiet=True,
    )  # fmt: skip
    assert curves.columns == ("n", "seed", "frame", "time", "frogs", "x")
    assert len(curves) == 2 * 3 * 5
    assert curves["n"].tolist() == [2] * 15 + [5] * 15
    assert curves["frogs"].tolist() == curves["n"].tolist()
    alone = run(many(), frames=4, seed=2, n=5, collect={"x": Frog.x.mean()}).table()
    rows = (curves["n"] == 5) & (curves["seed"] == 2)
    assert np.array_equal(curves["x"][rows], alone["x"])


def test_a_sweep_without_collected_data_returns_outcomes():
    table = sweep(many(), {"n": [2, 5]}, seeds=[7], frames=4, quiet=True)
    assert table["frames"].tolist() == [4, 4]
    assert table["digest"][1] == run(many(), frames=4, seed=7, n=5).digest
    assert set(table["error"]) == {""}


def test_agents_of_a_sweep_are_a_table_too():
    table = sweep(many(), seeds=2, frames=1, collect={"n": count(Frog), "age": Frog.age},
                  table="AFrog", quiet=True)  # fmt: skip
    assert table.columns == ("seed", "frame", "id", "age")
    assert len(table) == 2 * 2 * 2


def test_a_sweep_goes_on_where_it_was(tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()

    class Killer(Agent, symbol="AKiller"):
        x: int = 0

        @on("eTick")
        def live(self, tick, moment):
            self.x += 1
            if self.x == 3:
                (marks / f"{moment.frame.seed}-{os.getpid()}").touch()
                if moment.frame.seed == 3 and not (tmp_path / "go").exists():
                    os.kill(os.getppid(), signal.SIGINT)
                    signal.pause()

    world = World("AKiller#k", agents=[Killer], services=[each(eTick)])

    def go():
        return sweep(world, seeds=5, frames=4, collect=[Killer.x], folder=tmp_path / "kept",
                     workers=1, quiet=True)  # fmt: skip

    with pytest.raises(KeyboardInterrupt):
        go()
    (tmp_path / "go").touch()
    table = go()
    assert table["x"].tolist() == [0, 1, 2, 3, 4] * 5
    runs = [path.name.partition("-")[0] for path in marks.iterdir()]
    assert sorted(runs) == ["0", "1", "2", "3", "3", "4"]  # The finished runs are not repeated.


@pytest.mark.parametrize(("make", "problem"), [
    (lambda: sweep(many(), {"m": [1]}, frames=2, quiet=True), "no option"),
    (lambda: sweep(many(), {"n": 3}, frames=2), "expected a list of values"),
    (lambda: sweep(many(), {"n": [3, 3]}, frames=2), "is given twice"),
    (lambda: sweep(many(), frames=2), "nothing to sweep"),
    (lambda: sweep(many(), {"n": []}, frames=2), "nothing to sweep"),
    (lambda: sweep(many(), seeds=2), "has no end"),
    (lambda: sweep(many(), seeds=2, frames=2, collect={"y": "AFrog.y"}), "no y"),
])  # fmt: skip
def test_mistakes_in_sweeps_are_explained(make, problem):
    with pytest.raises(MinervaError, match=problem):
        make()


def test_runs_that_fail_are_shown_and_the_others_count(capsys):
    class Picky(Agent, symbol="APicky"):
        x: int = 0

        @on("eTick")
        def live(self, tick, moment):
            if moment.frame.seed == 1:
                raise ValueError("not this one")
            self.x += 1

    world = World("APicky#p", agents=[Picky], services=[each(eTick)])
    table = sweep(world, seeds=3, frames=2, collect=[Picky.x], quiet=True)
    assert sorted(set(table["seed"].tolist())) == [0, 2]
    assert "not this one" in capsys.readouterr().err
    with pytest.raises(MisuseError, match=r"all runs failed.*not this one"):
        sweep(world, seeds=[1], frames=2, quiet=True)


def largest(outcome):
    return max(node.state["size"] for node in outcome.scene.nodes if hasattr(node, "state"))


def test_strings_evolve():
    world = World("AFrog#a<size=1>", agents=[Frog], services=[each(eTick)], name="evolving")
    best = evolve_strings(world, largest, population=4, generations=3, frames=2, quiet=True,
                          mutable=["AFrog.size=0:9"])  # fmt: skip
    assert best.fitness > 1
    assert best.generations["generation"].tolist() == [0, 1, 2, 3]
    assert best.generations["best"].max() == best.fitness
    strings = best.strings
    assert strings["number"].tolist() == list(range(16))
    assert strings["string"][0] == str(world.scene)
    assert (strings["parents"][0], strings["generation"][15]) == ("", 3)
    assert str(best.scene) in strings["string"][strings["fitness"] == best.fitness]
    assert best.digest in strings["digest"]
    assert (
        run(World(best.scene, agents=[Frog], services=[each(eTick)]), frames=2).digest
        == best.digest
    )
    with pytest.raises(MisuseError, match="no match"):
        evolve_strings(world, largest, frames=2, mutable=["#zed"], quiet=True)
    with pytest.raises(MisuseError, match="no string could be evaluated"):
        evolve_strings(world, lambda outcome: "x", frames=2, generations=0, quiet=True)


@pytest.mark.parametrize("call", [
    lambda odd: sweep(pond(), odd, frames=1, quiet=True),
    lambda odd: sweep(pond(), seeds=[odd], frames=1, quiet=True),
    lambda odd: sweep(pond(), seeds=odd, frames=1, quiet=True),
    lambda odd: branch("pond.mcap", odd, world=pond()),
], ids=["grid", "seeds", "number of seeds", "branch"])  # fmt: skip
def test_odd_arguments_are_refused_by_an_error_of_ours(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    record(pond(), "pond.mcap", frames=2)
    check_refusals(call)
