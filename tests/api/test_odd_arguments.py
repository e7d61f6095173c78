"""Values of wrong types in public functions: an error of ours, which names the argument."""

import pytest
from frogs import Frog, pond

from minerva_analysis import diff, explain, export, graph, replay_swapped
from minerva_bus import (
    EMPTY,
    EventType,
    Geometry,
    MinervaError,
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
    replay,
    replay_views,
    resume,
    run,
    service,
    visualize,
)
from minerva_exporters import export_dataset
from minerva_study import branch, sweep

ODD = (None, 3, -1, 10**30, float("nan"), "x", b"x", "\ud800", "\0", [], {}, {1: 2}, object(), Frog)
"""Some of them are valid for some of the arguments."""


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
    "graph": lambda odd, made: graph(odd),
    "many ids": lambda odd, made: Frog.many(odd, 2),
    "many count": lambda odd, made: Frog.many("a", odd),
    "id": lambda odd, made: Frog(odd),
    "count": lambda odd, made: count(odd),
    "condition": lambda odd, made: run(pond(), frames=1, collect={"n": count(Frog, odd)}),
    "interval": lambda odd, made: Frog.size.every(odd),
    "diff": lambda odd, made: diff(odd, made[0] / "pond.mcap"),
    "record": lambda odd, made: record(pond(), odd, frames=1),
    "replay": lambda odd, made: replay(odd, pond()),
    "resume": lambda odd, made: resume(odd, pond(), frames=3),
    "explain agent": lambda odd, made: explain(made[0] / "pond.mcap", odd, "size", world=pond()),
    "explain value": lambda odd, made: explain(made[0] / "pond.mcap", "a", odd, world=pond()),
    "explain frame": lambda odd, made: explain(made[0] / "pond.mcap", "a", "size", odd, pond()),
    "export": lambda odd, made: export(odd),
    "export begin": lambda odd, made: export(made[0] / "pond.mcap", begin=odd),
    "export end": lambda odd, made: export(made[0] / "pond.mcap", end=odd),
    "export every": lambda odd, made: export(made[0] / "pond.mcap", every=odd),
    "export into": lambda odd, made: export(made[0] / "pond.mcap", into=odd),
    "data set": lambda odd, made: export_dataset(made[0] / "pond.mcap", made[0] / "set", odd),
    "swapped": lambda odd, made: replay_swapped(made[0] / "pond.mcap", odd, "each", pond()),
    "views": lambda odd, made: replay_views(made[0] / "pond.mcap", odd, pond(), quiet=True),
    "grid": lambda odd, made: sweep(pond(), odd, frames=1, quiet=True),
    "seeds": lambda odd, made: sweep(pond(), seeds=[odd], frames=1, quiet=True),
    "number of seeds": lambda odd, made: sweep(pond(), seeds=odd, frames=1, quiet=True),
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
    "branch": lambda odd, made: branch(made[0] / "pond.mcap", odd, world=pond()),
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
    refused = 0
    for odd in ODD:
        try:
            CALLS[name](odd, made)
        except MinervaError as error:
            assert str(error).strip()
            refused += 1
    assert refused
