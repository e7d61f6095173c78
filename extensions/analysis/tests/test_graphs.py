"""The graph of a world: its content in each form, for installed worlds and for others."""

import importlib
import json
import re
import sys
from pathlib import Path

import pytest

from minerva_analysis import graph
from minerva_analysis.emitted import emitted_by
from minerva_analysis.graphs import mermaid
from minerva_bus import Agent, EventType, Generator, MinervaError, World, each, on, view
from minerva_bus.launch.installed import installed_worlds
from minerva_bus.world.operator import MemberStatus, WorldStatus

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from tests.runtime.running import minerva

eTick = EventType("eTick")
eSing = EventType("eSing", pitch=float)
eRest = EventType("eRest")
eShow = EventType("eShow", visual=True)


def sing(moment):
    moment.emit(eSing(1.0))


class Chick(Agent, symbol="AChick"):
    @on("eRest")
    def rest(self, rest, moment):
        moment.emit(eRest())


class Bird(Agent, symbol="ABird"):
    mood: float = 0.5

    @on("eTick", "eSing", probability="mood")
    def live(self, event, moment):
        sing(moment)
        return self.string + self.child(Chick)

    @view("eShow")
    def picture(self, event):
        return None


class Wind(Generator, events=("eRest",), when="freely"):
    publishes = ("gusts",)

    def takes_orders(self):
        return ("eRest",)


class Vane(Generator, events=("eTick",)):
    topics = ("gusts",)


def birds():
    return World(
        "ABird#a · ABird#b · AChick#c", agents={"birds": Bird, "chicks": [Chick]},
        services={"wind": Wind, "vane": Vane, "clock": each(eTick)},
        order=["eTick", "eSing"], name="birds", symbols=[eShow],
    )  # fmt: skip


def test_events_are_in_the_order_of_a_frame_with_their_publishers_and_receivers():
    made = graph(birds())
    assert [(each.name, each.rank) for each in made.events] == [
        ("eTick", 1), ("eSing", 2), ("eRest", 3), ("eShow", 4),
    ]  # fmt: skip
    assert made.publishers("eTick") == ["vane", "clock"]
    assert made.publishers("eSing") == ["ABird"]
    assert made.publishers("eRest") == ["wind", "AChick", "people"]
    assert made.receivers("eSing") == made.receivers("eShow") == ["ABird"]
    assert made.receivers("eRest") == ["AChick"]
    bird, chick = made.kinds
    assert (bird.symbol, bird.initial, bird.chances) == (
        "ABird",
        2,
        {"eTick": "mood", "eSing": "mood"},
    )
    # The code of an agent that it creates is not its own.
    assert (bird.emits, chick.emits) == (("eSing",), ("eRest",))


def test_code_of_installed_packages_counts_if_it_uses_the_platform(tmp_path, monkeypatch):
    folder = tmp_path / "site-packages"
    folder.mkdir()
    (folder / "letters.py").write_text(
        "from minerva_bus import Agent, EventType, on\n"
        'eLetter = EventType("eLetter")\n'
        "class Writer(Agent):\n"
        '    @on("eTick")\n'
        "    def write(self, tick, moment):\n"
        "        moment.emit(eLetter())\n"
    )
    monkeypatch.syspath_prepend(folder)
    letters = importlib.import_module("letters")
    clerk = type("Clerk", (letters.Writer,), {"__module__": __name__}, symbol="AClerk")
    assert emitted_by(clerk) == {"eLetter"}
    assert emitted_by(Bird) == {"eSing"}


def test_processes_have_their_roles_topics_and_copies():
    processes = {each.name: each for each in graph("meadow").processes}
    assert (processes["rabbits"].count, processes["rabbits"].role) == (2, "host")
    assert processes["rabbits"].hosts == ("ARabbit",)
    processes = {each.name: each for each in graph(birds()).processes}
    assert (processes["wind"].role, processes["wind"].when) == ("generator", "freely")
    assert processes["wind"].writes == processes["vane"].reads == ("gusts",)


@pytest.mark.parametrize("name", sorted(installed_worlds()))
def test_every_installed_world_has_a_graph_in_every_form(name):
    made = graph(name)
    json.dumps(made.plain())
    check_mermaid(made)
    kinds = {kind for process in made.processes for kind in process.hosts}
    # A world that runs has a host for each agent and a receiver for each generator.
    assert {kind.symbol for kind in made.kinds if kind.initial} <= kinds
    sent = {event for process in made.processes for event in process.publishes}
    assert sent <= {event.name for event in made.events}


def check_mermaid(made):
    """Each line of the flowchart is a node, an edge, a subgraph or a style; edges join nodes."""
    lines = [line.strip() for line in mermaid(made).splitlines()]
    assert lines[0] == "flowchart LR"
    assert lines.count("end") == sum(line.startswith("subgraph") for line in lines)
    nodes = {m[1] for line in lines if (m := re.match(r'(?:subgraph )?(\w+)(?:\[|\(\[)"', line))}
    edges = [
        re.split(r'\s(?:-->|-\.->|-\. ".*" \.->|==\s".*"\s==>)(?:\|".*"\|)?\s', line)
        for line in lines
    ]
    pairs = [edge for edge in edges if len(edge) == 2]
    assert pairs
    assert {name for pair in pairs for name in pair} <= nodes
    heads = ("flowchart", "subgraph", "end", "classDef", "class ")
    rest = [line for line, edge in zip(lines, edges, strict=True) if len(edge) < 2]
    assert all(line.startswith(heads) or re.match(r"\w+(\[|\(\[)", line) for line in rest)


def test_a_new_world_has_a_graph(tmp_path):
    assert minerva(tmp_path, "new", "world", "my_yard").returncode == 0
    (file,) = (tmp_path / "my_yard").rglob("*.toml")
    done = minerva(tmp_path, "graph", file, "--json")
    assert done.returncode == 0, done.stderr
    made = json.loads(done.stdout)
    assert made["order"] == [event["name"] for event in made["events"]]
    assert any(event["publishers"] and event["receivers"] for event in made["events"])


def test_the_command_prints_and_writes_mermaid(tmp_path):
    done = minerva(tmp_path, "graph", "warehouse")
    assert done.stdout == graph("warehouse").mermaid()
    words = ("-o", "w.mmd", "--view", "svg", "--carriers", "7")
    done = minerva(tmp_path, "graph", "warehouse", *words)
    assert done.stdout == "w.mmd\n"
    assert "ACarrier ×7" in (tmp_path / "w.mmd").read_text()
    assert "a_carriers_20_ACarrier == " in (tmp_path / "w.mmd").read_text()
    # Written again, because it is ours; a file of somebody else's is not overwritten.
    assert minerva(tmp_path, "graph", "warehouse", *words).returncode == 0
    (tmp_path / "own.mmd").write_text("flowchart TB")
    done = minerva(tmp_path, "graph", "warehouse", "-o", "own.mmd")
    assert (done.returncode, (tmp_path / "own.mmd").read_text()) == (2, "flowchart TB")


def test_the_guide_shows_the_graph_of_a_world(tmp_path):
    shown = minerva(tmp_path, "graph", "plants", "--view", "svg").stdout.splitlines()
    guide = (Path(__file__).parents[1] / "graph.md").read_text(encoding="utf-8")
    assert "\n".join(shown[1:]) in guide


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("warehouse", "-o", "w.png"), "mermaidx -i w.mmd -o w.svg"),
        (("werehouse",), "there is no world 'werehouse'; did you mean 'warehouse'?"),
        (("warehouse", "--cariers", "7"), "did you mean '--carriers'?"),
        (("warehouse", "--outputt", "a.svg"), "did you mean '--output'?"),
    ],
)
def test_wrong_words_are_explained(tmp_path, words, said):
    done = minerva(tmp_path, "graph", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) <= 10


def test_a_graph_is_not_drawn(tmp_path):
    with pytest.raises(MinervaError, match=r"a graph is written as Mermaid text, into a \.mmd; to"):
        graph("warehouse").save(tmp_path / "a.svg")


def test_notebooks_draw_the_text():
    made = graph("warehouse")
    assert made._repr_markdown_() == f"```mermaid\n{made.mermaid()}```"


def test_odd_names_are_escaped():
    world = World("ABird#a", agents={"p.1~x": Bird, "p-1~x": Chick}, symbols=[eShow], name="a.b~c")
    made = graph(world)
    check_mermaid(made)
    assert 'subgraph p_p_2e_1_7e_x["p.1~x"]' in mermaid(made)


def test_a_running_world_adds_its_rates():
    sent = {"foxes": 20.0, "rabbits-1": 50.0, "rabbits-2": 75.0, "rabbits-9x": 1.0}
    members = tuple([MemberStatus(name, "present", sent=size) for name, size in sent.items()])
    status = WorldStatus("meadow", 1, 0.1, "tick", hz=20.0, members=members, events={"eRain": 9.6})
    text = graph("meadow").with_rates(status).mermaid()
    for line in ('eRain, pub<br>10/s"', 'eBite<br>0/s"', 'rabbits ×2<br>sends 2.5 kB/s"'):
        assert line in text
