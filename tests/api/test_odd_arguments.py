"""Values of wrong types in public functions: an error of ours, which names the argument."""

import pytest
from frogs import Frog, pond

from minerva_bus import (
    EMPTY,
    EventType,
    Geometry,
    Primitive,
    Range,
    World,
    check,
    connect,
    count,
    each,
    evolve,
    interpret,
    record,
    resume,
    run,
    service,
    visualize,
)
from tests.odd_arguments import check_refusals


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a record, the run, and a live world."""
    folder = tmp_path_factory.mktemp("odd")
    kept = record(pond(), folder / "pond.mcap", frames=2, collect={"frogs": count(Frog)})
    with pond().start() as live:
        yield folder, kept, live


def world(**settings):
    return World("AFrog#a", agents=[Frog], services=[each("eTick")], **settings)


CALLS = {
    "run world": lambda odd, made: run(odd, frames=1),
    "run frames": lambda odd, made: run(pond(), frames=1 if odd == 10**30 else odd, until=""),
    "run seed": lambda odd, made: run(pond(), frames=1, seed=odd),
    "run rate": lambda odd, made: run(pond(), frames=1, rate=odd),
    "run processes": lambda odd, made: run(pond(), frames=1, processes=odd, bus=False),
    "run collect": lambda odd, made: run(pond(), frames=1, collect=odd),
    "run entry": lambda odd, made: run(pond(), frames=1, collect={"n": odd}),
    "run into": lambda odd, made: run(pond(), frames=1, collect={"n": count(Frog)}, into=odd),
    "run film": lambda odd, made: run(pond(), frames=1, film=odd),
    "string": lambda odd, made: World(odd, agents=[Frog], services=[each("eTick")]),
    "string that code makes": lambda odd, made: World(lambda options: odd, agents=[Frog]),
    "agents": lambda odd, made: World("AFrog#a", agents=odd, services=[each("eTick")]),
    "agents of a process": lambda odd, made: World("AFrog#a", agents={"frogs": odd}),
    "services": lambda odd, made: World("AFrog#a", agents=[Frog], services=odd),
    "name": lambda odd, made: world(name=odd),
    "options": lambda odd, made: world(options=odd),
    "norms": lambda odd, made: world(norms=odd),
    "placement": lambda odd, made: world(placement=odd),
    "symbols": lambda odd, made: world(symbols=odd),
    "order": lambda odd, made: world(order=odd),
    "each": lambda odd, made: World("AFrog#a", agents=[Frog], services=[each(odd)]),
    "service": lambda odd, made: World("AFrog#a", agents=[Frog], services=[service(odd)]),
    "save": lambda odd, made: pond().save(odd),
    "load": lambda odd, made: World.load(odd),
    "check": lambda odd, made: check(odd),
    "many ids": lambda odd, made: Frog.many(odd, 2),
    "many count": lambda odd, made: Frog.many("a", odd),
    "id": lambda odd, made: Frog(odd),
    "count": lambda odd, made: count(odd),
    "condition": lambda odd, made: run(pond(), frames=1, collect={"n": count(Frog, odd)}),
    "interval": lambda odd, made: Frog.size.every(odd),
    "record": lambda odd, made: record(pond(), odd, frames=1),
    "resume": lambda odd, made: resume(odd, pond(), frames=3),
    "connect": lambda odd, made: connect(odd or "x"),
    "endpoint": lambda odd, made: connect(endpoint=odd or "x"),
    "step": lambda odd, made: made[2].step(0 if odd == 10**30 else odd),
    "publish": lambda odd, made: made[2].publish(odd),
    "view": lambda odd, made: made[2].view(odd),
    "table": lambda odd, made: made[1].table(odd),
    "column": lambda odd, made: made[1].table()[odd],
    "plot": lambda odd, made: made[1].table().plot(odd),
    "plot x": lambda odd, made: made[1].table().plot(x=odd),
    "plot path": lambda odd, made: made[1].plot(odd),
    "csv": lambda odd, made: made[1].table().to_csv(odd),
    "range": lambda odd, made: Range(odd, 1),
    "evolve": lambda odd, made: evolve(pond().scene, (), [odd]),
    "evolve string": lambda odd, made: evolve(odd, (), [Frog]),
    "evolve events": lambda odd, made: evolve(pond().scene, odd, [Frog]),
    "evolve event": lambda odd, made: evolve(pond().scene, [odd], [Frog]),
    "evolve kinds": lambda odd, made: evolve(pond().scene, (), odd),
    "evolve frame": lambda odd, made: evolve(pond().scene, (), [Frog], odd),
    "evolve policy": lambda odd, made: evolve(pond().scene, (), [Frog], policy=odd),
    "visualize string": lambda odd, made: visualize(odd, (), [Frog]),
    "visualize event": lambda odd, made: visualize(pond().scene, [odd], [Frog]),
    "interpret string": lambda odd, made: interpret(odd, Geometry()),
    "interpret geometry": lambda odd, made: interpret(EMPTY, odd),
    "form": lambda odd, made: Primitive("PLeaf", odd),
    "event condition": lambda odd, made: EventType("eWind")(condition=odd),
    "picture path": lambda odd, made: made[1].picture().save(odd),
}


@pytest.mark.parametrize("name", CALLS)
def test_odd_arguments_are_refused_by_an_error_of_ours(name, made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refusals(lambda odd: CALLS[name](odd, made))
