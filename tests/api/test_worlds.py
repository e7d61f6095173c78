"""Worlds, runs and stepping in this process."""

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from weakref import ref

import frogs as module
import pytest
from frogs import Frog, PFrog, TAt, eFeed, ePicture, eTick, pond

from minerva_bus import (
    Agent,
    EventType,
    MinervaError,
    Primitive,
    Transformation,
    Vocabulary,
    World,
    each,
    on,
    parse,
    run,
    service,
    view,
)
from minerva_bus.errors import BusError, MisuseError, SceneError, WorldFileError, WorldStopped
from minerva_bus.world.services import Generator

DIGEST = run(pond(), frames=20, seed=5).digest


def test_a_vocabulary_is_collected_from_the_code():
    vocabulary = pond().vocabulary
    assert [*vocabulary.kinds] == ["AFrog"]
    assert [*vocabulary.primitives] == ["PFrog"]  # Referenced only by a function that a view calls.
    assert [*vocabulary.transformations] == ["TAt"]
    assert [*vocabulary.events] == ["eCroak", "eFeed", "ePicture", "eTick"]


def test_symbols_may_be_a_vocabulary():
    pond = World("ε", agents=[], services=[each(eTick)], symbols=Vocabulary.of(PFrog))
    assert "PFrog" in pond.vocabulary.primitives


def test_agents_are_found_where_the_world_is_made():
    eGo = EventType("eGo")

    class Walker(Agent, symbol="AWalker"):
        x: int = 0

        @on("eGo")
        def go(self, event, moment):
            self.x += 1

    world = World("AWalker#w", services=[each(eGo)])
    assert str(run(world, frames=4).scene) == "AWalker#w<x=4>()"


@pytest.mark.parametrize("nested", [False, True])
def test_symbols_beside_and_around_many_agents_are_collected(nested):
    PTree = Primitive("PTree")
    TTilt = Transformation("TTilt", angle=float)
    beside = Frog.many("f", 100) + TTilt(0.5)(PTree())
    string = TTilt(1.0)(beside) if nested else beside
    assert [type(piece).__name__ for piece in beside.pieces] == ["Columns", "TransformationNode"]
    vocabulary = World(string, services=[each(eTick)]).vocabulary
    assert [*vocabulary.kinds] == ["AFrog"]
    assert "PTree" in vocabulary.primitives
    assert "TTilt" in vocabulary.transformations


def test_symbols_of_services_modules_and_arguments_are_collected():
    eAsk = EventType("eAsk")
    PStone = Primitive("PStone")

    class Asker(Generator, events=("eAsk",)):
        def __init__(self, times: int = 1) -> None:
            self.times = times

        def generate(self, tick):
            return [eAsk()] * self.times

    class Quiet(Agent, symbol="AQuiet"):
        heard: int = 0

        @on("eAsk")
        def hear(self, event, moment):
            self.heard += 1

        @view("ePicture")
        def picture(self, event):
            return module.TAt(1.0)(module.PFrog(2.0))

    world = World(
        "PStone · AQuiet#q", services={"ask": service(Asker, times=1)}, symbols=[ePicture]
    )
    assert run(world, frames=3).events == {"eAsk": 3}
    assert "PStone" in world.vocabulary
    assert {"PFrog", "TAt", "ePicture"} <= {
        *world.vocabulary.primitives, *world.vocabulary.transformations, *world.vocabulary.events
    }  # fmt: skip
    assert PStone.name == "PStone"


def test_options_of_a_world_made_in_python():
    def frogs(options):
        return Frog.many("f", options["n"], size=options["size"])

    world = World(frogs, agents=[Frog], services=[each(eTick)], options={"n": 3, "size": 2.0})
    assert len(run(world, frames=1).scene) == 3
    assert len(run(world, frames=1, n=40).scene) == 40
    with pytest.raises(WorldFileError, match="no option 'm'"):
        run(world, frames=1, m=40)
    with pytest.raises(WorldFileError, match=r"^n must be a whole number"):
        run(world, frames=1, n="many")
    with pytest.raises(WorldFileError, match=r"^frames must be a whole number, not '1'"):
        run(world, frames="1")
    with pytest.raises(SceneError, match=r"^world.string:1:1: AFrog#f has no weight"):
        World("AFrog#f<weight=1>", agents=[Frog])


def test_options_fill_strings_and_services():
    made = World("AFrog#a<x=${far}>", options={"far": 2.0, "n": 2}, services=[each(eTick, "${n}")])
    assert made.scene.pieces[0].state["x"] == 2.0
    assert run(made, frames=4).events["eTick"] == 2
    assert run(made, frames=4, n=1).events["eTick"] == 4


@pytest.mark.parametrize(("make", "problem"), [
    (lambda: World("AFrog#a", agents=[Frog], services=[each("eTik")]), "eTik"),
    (lambda: World("AFrog#a", agents=[Frog], services=["eech"]), "no service 'eech'"),
    (lambda: each(eTick()), r"each\(eTick\): expected an event type"),
    (lambda: World("AFrog#a", agents=[Frog], services=[3]), "a class or an installed name"),
    (lambda: World("AFrog#a", agents=[Frog], seeed=3), "no setting 'seeed'; did you mean 'seed'"),
    (lambda: World("AFrog#a", agents=[Frog], services=[each(eTick), each(eTick)]), "two services"),
    (lambda: World("AFog#a", agents=[Frog]), "has no AFog; did you mean 'AFrog'"),
    (lambda: World("ANewt#n"), r"has no ANewt; declare or import it there, or give World agents=\[...\]"),
    (lambda: World("AFrog#a<x=", agents=[Frog]), "\\^"),
    (lambda: parse("AFrog#a", Vocabulary.of(PFrog)), r"Vocabulary.of\(...\).check\(parse\(text\)\)"),
    (lambda: parse(Frog("a")), "parse takes a text"),
    (lambda: World(3, agents=[Frog]), "a text, a Scene, or a function that returns one"),
    (lambda: World([Frog("a"), Frog("b")], agents=[Frog]), r"of agents: Fox\('a'\).string \+"),
    (lambda: World("AFrog#a", agents=["Frog"]), "is not a symbol"),
    (lambda: World("AFrog#a", agents=[Frog("a")]), "is an agent: give its class, Frog"),
    (lambda: World("AFrog#a", agents=Frog), r"agents is a list, such as agents=\[Fox\], not"),
    (lambda: World("AFrog#a", agents="Frog"), r"agents is a list"),
    (lambda: World("AFrog#a", agents=[Frog], services=each(eTick)), "services is a list"),
    (lambda: World("AFrog#a", symbols=PFrog), "symbols is a list"),
    (lambda: World("AFrog#a", devices=[]), "no setting 'devices'; did you mean 'services'"),
    (lambda: World("AFrog#a", agent=[Frog]), "no setting 'agent'; did you mean 'agents'"),
    (lambda: run(pond(), frame=3), "no option 'frame'; did you mean 'frames'"),
    (lambda: World("AFrog#a", agents=[Frog], frames="x"), "whole number"),
    (lambda: run(pond()), r"has no end: run\(world, frames=300\)"),
    (lambda: run(pond(), frames=3, processes=0), "at least 1"),
    (lambda: run(5, frames=3), "is neither a World"),
    (lambda: run("nowhere.toml", frames=3), "no world file nowhere.toml"),
    (lambda: pond().save("pond.txt"), "ends in .toml"),
])  # fmt: skip
def test_mistakes_are_explained(make, problem):
    with pytest.raises(MinervaError, match=problem):
        make()


def test_a_world_is_read_once():
    calls = []

    def frogs(options):
        calls.append(options)
        return Frog.many("f", 3)

    world = World(frogs, agents=[Frog], services=[each(eTick)], name="once")
    made = len(calls)
    assert world.name == "once"
    assert world.scene is world.scene
    assert world.vocabulary is world.vocabulary
    world.agents.clear()
    assert world.agents == [Frog]
    assert "Frog" in repr(world)
    assert len(calls) == made
    run(world, frames=1)
    assert len(calls) == made + 1


def test_a_saved_world_is_the_same(tmp_path):
    path = tmp_path / "pond.toml"
    pond().save(path)
    loaded = World.load(path)
    assert loaded.vocabulary == pond().vocabulary
    assert run(loaded, frames=20, seed=5).digest == DIGEST
    assert loaded.toml() == path.read_text()


def test_a_local_class_cannot_be_saved(tmp_path):
    PSpot = Primitive("PSpot")

    class Hidden(Agent, symbol="AHidden"):
        x: int = 0

        @view("ePicture")
        def picture(self, event):
            return PSpot()

    world = World("AHidden#h", agents=[Hidden])
    with pytest.raises(MisuseError, match=r"^Hidden is defined in a function or cell.*move it"):
        world.save(tmp_path / "hidden.toml")
    with pytest.raises(MisuseError, match="move it into a module"):
        run(world, frames=1, bus=True)


def test_a_class_of_the_program_cannot_reach_processes(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(
        "from minerva_bus import *\n"
        "eTick = EventType('eTick')\n"
        "class Frog(Agent, symbol='AFrog'):\n"
        "    age: int = 0\n"
        "    @on('eTick')\n"
        "    def live(self, tick, moment):\n"
        "        self.age += 1\n"
        "world = World('AFrog#a', services=[each(eTick)])\n"
        "print(run(world, frames=3).scene)\n"
        "run(world, frames=3, bus=True)\n"
    )
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, check=False)
    assert done.stdout == "AFrog#a<age=3>()\n"
    assert "defined in the program that runs (__main__)" in done.stderr
    assert "from agents import" in done.stderr


def test_a_run_says_what_came_out():
    done = run(pond(), frames=6)
    assert (done.frames, done.ended, done.reached) == (6, "the frames are over", False)
    assert done.digest == done.scene.digest.hex()
    assert done.events == {"eCroak": 6, "eTick": 6}
    with pytest.raises(MisuseError, match="nothing was collected"):
        done.table()


def test_stepping_gives_the_same_world():
    with pond(seed=5).start() as live:
        assert live.frame == 0
        assert not live.ended
        assert live.step(15) == 15
        assert live.step() == 16
        live.step(4)
        assert live.digest == DIGEST
        assert live.status.frame == 20


def test_events_and_views_of_a_live_world():
    with pond().start() as live:
        live.publish(eFeed(amount=4.0))
        live.publish(eFeed(amount=1.0, receivers=["b"]))
        live.step()
        sizes = [node.state["size"] for node in live.scene.nodes if hasattr(node, "state")]
        assert sizes == [5.0, 7.0]
        assert live.sent == ()
        assert live.view("ePicture") == live.view(ePicture) == live.view(ePicture())
        assert {node.symbol for node in live.view("ePicture")} == {"TAt"}
        with pytest.raises(MisuseError, match="not visual"):
            live.view(eTick)
        with pytest.raises(MisuseError, match="did you mean 'ePicture'"):
            live.view("ePictur")
        with pytest.raises(BusError, match="people"):
            live.publish(eTick())
        with pytest.raises(BusError, match="no agent #z"):
            live.publish(eFeed(amount=1.0, receivers=["z"]))
        for frames in (0, 2.5, "2", True):
            with pytest.raises(MisuseError, match="at least 1"):
                live.step(frames)
    assert live.ended


def test_tables_of_a_live_world_grow():
    with pond().start(collect=[Frog.age]) as live:
        assert live.table()["age"].tolist() == [0, 0, 0]
        live.step(2)
        assert live.table()["age"].tolist() == [0] * 3 + [1] * 3 + [2] * 3


def test_a_world_without_events_is_stepped_at_once():
    class Stone(Agent, symbol="AStone"):
        x: int = 0

    with World("AStone#s", agents=[Stone]).start() as live:
        live.step(50)
        assert live.frame == 50


def test_what_is_no_event_cannot_be_published():
    with pond().start() as live:
        for given in ("eFeed", eFeed):
            with pytest.raises(
                MisuseError, match=r"an event, such as eSun\(heat=0.5\), not .*eFeed"
            ):
                live.publish(given)


def test_a_live_world_ends_at_its_end():
    with pond().start(frames=3) as live:
        assert live.step(10) == 3
        assert live.ended
        assert live.step() == 3


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])  # The latter is no Ctrl-C.
def test_an_error_in_a_world_is_raised(error):
    class Broken(Agent, symbol="ABroken"):
        x: int = 0

        @on("eTick")
        def fail(self, tick, moment):
            raise error("no good")

    world = World("ABroken#b", agents=[Broken], services=[each(eTick)])
    with pytest.raises(WorldStopped, match="no good"):
        run(world, frames=1)
    with world.start() as live:
        with pytest.raises(WorldStopped, match="no good"):
            live.step()
        assert live.ended


def test_an_interrupt_ends_a_world_and_is_raised():
    closed = []

    class Late(Generator, events=("eTick",)):
        def generate(self, tick):
            if tick.number == 3:
                signal.raise_signal(signal.SIGINT)  # As Ctrl-C does; the frame is completed.
            return [eTick()]

        def close(self):
            closed.append(True)

    world = World("AFrog#a", agents=[Frog], services=[Late])
    with pytest.raises(KeyboardInterrupt):
        run(world, frames=10)
    assert closed
    with world.start() as live:
        with pytest.raises(KeyboardInterrupt):
            live.step(10)
        assert live.ended
        assert live.frame == 4


def test_prints_between_steps_are_the_programs(capsys):
    with pond().start() as live:
        live.step()
        print("mine")
    assert capsys.readouterr().out == "mine\n"


def test_vocabularies_may_be_given():
    whole = Vocabulary.of(PFrog, TAt, eTick, eFeed, ePicture, module.eCroak, Frog)
    world = World("AFrog#a", agents=[Frog], services=[each(eTick)], symbols=[whole])
    assert world.vocabulary == whole


def test_forgotten_worlds_leave_no_module():
    world = pond()
    name = world.read().world.name
    count = sum(each.startswith("minerva_world_") for each in sys.modules)
    del world
    import gc

    gc.collect()
    assert name == "pond"
    assert sum(each.startswith("minerva_world_") for each in sys.modules) < count


def test_a_running_world_ends_with_its_last_variable_though_worlds_were_made_beside_it():
    program = {"pond": pond, "World": World, "Frog": Frog, "each": each, "eTick": eTick, "ref": ref}
    exec("live = pond().start(); forgotten = ref(live)", program)
    exec("world = World('AFrog#a', agents=[Frog], services=[each(eTick)])", program)
    exec("del live; kept = forgotten()", program)
    assert program["kept"] is None
    assert program["world"].toml()


def test_a_live_world_answers_and_steps_in_any_thread():
    with pond(seed=5).start() as live, ThreadPoolExecutor(1) as other:
        live.step()
        other.submit(live.publish, eFeed(amount=1.0)).result()
        assert other.submit(live.step, 7).result() == 8
        assert other.submit(lambda: live.status.frame).result() == 8
        live.publish(eFeed(amount=1.0))
        live.step()
        digest = live.digest
    with pond(seed=5).start() as live:
        live.step()
        live.publish(eFeed(amount=1.0))
        live.step(7)
        live.publish(eFeed(amount=1.0))
        live.step()
        assert live.digest == digest
