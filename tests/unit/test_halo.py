"""Halos: which figures a region shows another one, and what is refused."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.errors import ProtocolError, WorldFileError, WorldStopped
from minerva_bus.frame.member import Member
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.grammar.symbols import Primitive, Transformation
from minerva_bus.launch.in_process_parts import members_of
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.reading import read_world_text
from minerva_bus.launch.regions.unsupported import check_regions
from minerva_bus.regions.asking import answers_of
from minerva_bus.regions.figures import figures_in
from minerva_bus.regions.halo import HaloViews, near_cells
from minerva_bus.regions.halo_services import halo_services
from minerva_bus.regions.kept import check_saved, joined_parts, own_parts
from minerva_bus.regions.merging import Units
from minerva_bus.regions.messages import ParcelMessage, RepliesMessage, from_message
from minerva_bus.regions.partition import ByPosition
from minerva_bus.settings.overrides import Overrides
from minerva_bus.world.halo import Halo, agent_lines
from minerva_bus.world.services import Device, Generator
from minerva_services.physics.neighbours import Neighbours
from minerva_services.physics.service import Physics
from minerva_services.sensors.camera import Camera
from minerva_services.sensors.laser import Laser

PSpot = Primitive("PSpot", who=str)
PTree = Primitive("PTree", age=float)
TMove = Transformation("TMove", x=float, y=float)
GRID = ByPosition((2.0, 5.0), (4.0,), halo=True)
places = st.integers(0, 80).map(lambda number: number / 10)


def shown(points, number, size=None, radius=1.0):
    """The ids that a region with these figures shows each region."""
    halo = Halo(radius, size=size)
    nodes = [TMove(x, y)(PSpot(name)).nodes[0] for name, x, y in points]
    scenery = TMove(-9.0, -9.0)(PTree(3.0)).nodes[0]
    views: Any = HaloViews(number, {"eWhere": halo})
    pieces = Scene((*nodes, scenery)).pieces
    views._shown = {"eWhere": Units([(n,) for n in range(len(pieces))], pieces)}
    return {
        region: [
            name for piece in of.figures["eWhere"].pieces for name in figures_in(piece, halo).who
        ]
        for region, of in views.by_region(GRID).items()
    }


@given(
    st.lists(st.tuples(places, places), min_size=1, max_size=9), st.sampled_from([None, (8.0, 8.0)])
)
def test_whatever_is_within_the_radius_of_an_agent_is_shown_to_its_region(points, size):
    named = [(f"a{n}", x, y) for n, (x, y) in enumerate(points)]
    column = np.searchsorted(GRID.across, [x for _, x, _ in named], side="right")
    cells = (column + 3 * np.searchsorted(GRID.down, [y for *_, y in named], side="right")).tolist()
    seen = {number: set() for number in range(6)}
    for number in set(cells):
        own = [each for each, cell in zip(named, cells, strict=True) if cell == number]
        for region, names in shown(own, number, size).items():
            seen[region].update(names)
    for (_, x, y), cell in zip(named, cells, strict=True):
        for name, to_x, to_y in named:
            gaps = abs(np.array([x - to_x, y - to_y]))
            gaps = gaps if size is None else np.minimum(gaps, 8.0 - gaps)
            assert gaps @ gaps > 1.0 or name in seen[cell]


@pytest.mark.parametrize(
    ("x", "size", "regions"),
    [
        (2.5, None, {1: ["a"], 0: ["a"]}),
        (3.5, None, {1: ["a"]}),
        (4.0, None, {1: ["a"], 2: ["a"]}),
        (4.0, (8.0, 20.0), {1: ["a"], 2: ["a"]}),
    ],
)
def test_a_figure_is_shown_only_near_a_border(x, size, regions):
    assert shown([("a", x, 1.5)], 1, size) == regions


@pytest.mark.parametrize(("size", "near"), [(None, [1]), ((10.0, 8.0), [1, 9])])
def test_figures_are_compared_with_near_cells_only(size, near):
    cells = ByPosition(tuple(map(float, range(1, 10))), halo=True).cells
    assert near_cells(cells, 0, Halo(0.5, size=size)) == near
    assert near_cells(cells, 4, Halo(1.5, size=size)) == [2, 3, 5, 6]


def test_the_edges_of_a_torus_are_next_to_each_other():
    assert shown([("a", 8.0, 7.9)], 5, (8.0, 8.0)) == {5: ["a"], 0: ["a"], 2: ["a"], 3: ["a"]}


@pytest.mark.parametrize(
    ("x", "number", "size"),
    [(5.0, 1, None), (1.9, 1, None), (-0.1, 0, (8.0, 8.0)),
     (8.1, 2, (8.0, 8.0))],
)  # fmt: skip
def test_a_figure_outside_of_the_cell_of_its_agent_stops_the_world(x, number, size):
    with pytest.raises(WorldStopped, match=r"#a shows x = .* or halo = false"):
        shown([("a", x, 1.0)], number, size)


def test_the_figure_outside_is_named():
    with pytest.raises(WorldStopped, match=r"#b shows x = 5\.0, outside of .*, 2\.0 to 5\.0"):
        shown([("a", 2.5, 1.5), ("b", 5.0, 1.0), ("c", 3.0, 1.0)], 1)


FLOCK = find_world("flock")
TEXT = FLOCK.read_text(encoding="utf-8")
NORM = """
[norm.loud]
on = ["eNear"]
when = "event.number > 3"
"""


ON_A_PLANE = """
[process.more]
service = "neighbours"
"""


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[regions]\ncount = 2\nhalo = true", "add grid or tree"),
        ("[regions]\ngrid = { vx = [0] }\nhalo = true", "divided by vx, .* looks .* at x and y"),
        (f"[regions]\ngrid = {{ x = [30] }}\nhalo = true\n{NORM}", "norms on events of services"),
        (
            f"[regions]\ngrid = {{ x = [30] }}\nhalo = true\n{ON_A_PLANE}",
            "view, eWhere, .*other planes",
        ),
    ],
)
def test_what_halos_cannot_do_is_refused(text, problem):
    def check():
        file = read_world_text(f"{TEXT}\n{text}\n", FLOCK, Overrides())
        check_regions(file, members_of(file))

    with pytest.raises(WorldFileError, match=problem):
        check()


def test_a_world_without_such_services_is_refused():
    meadow = find_world("meadow")
    text = f"{meadow.read_text(encoding='utf-8')}\n[regions]\ngrid = {{ x = [8] }}\nhalo = true\n"
    with pytest.raises(WorldFileError, match="no service in step looks around agents"):
        read_world_text(text, meadow, Overrides())


@pytest.mark.parametrize("saved", [{"value": 1, "agents": 3}, {"seen": ["a"]}, {"on": True}])
def test_a_service_with_a_halo_saves_lines_of_agents_and_numbers(saved):
    with pytest.raises(
        WorldStopped, match=r'mine saves .* expected the texts of agents as "agents"'
    ):
        check_saved("mine", saved)


@pytest.mark.parametrize("kept", [3, "no tab", "a\tb\n"])
def test_invalid_texts_of_agents_are_refused(kept):
    with pytest.raises(ProtocolError, match="saved no lines of agents"):
        from_message(RepliesMessage(1, {}, {"collisions": kept}), 0, 1)


@pytest.mark.parametrize("kept", [3, "no tab", "a\tb\n"])
def test_invalid_texts_of_agents_near_a_border_are_refused(kept):
    message = ParcelMessage(1, None, b"", (), b"", halo_kept={"physics": kept})
    with pytest.raises(ProtocolError, match="saved no lines of agents"):
        from_message(message, 0, 1)


class Recorder(Device, draws=("ePicture",)):
    topics = ("scan",)

    def show(self, view): ...


class Filter(Generator, events=("eLaser",)):
    """A generator that reads what the laser reads, and may remember it for all robots."""

    topics = ("scan",)


@pytest.mark.parametrize(
    ("services", "near"),
    [
        ([Physics(), Laser(), Camera()], [0, 1, 2]),
        # What publishes scans and what reads them is in the same region.
        ([Physics(), Laser(), Recorder(), Camera(), Neighbours()], [4]),
        ([Physics(), Laser(), Filter(), Camera()], []),
        ([Laser(topic="other"), Neighbours(), None], [1]),
        ([Physics(), Laser(topic="other")], [0]),
    ],
)
def test_services_that_exchange_readings_run_in_each_region_together(services, near):
    grid = ByPosition((0.0,), halo=True)
    assert halo_services(grid, services) == [services[number] for number in near]
    assert halo_services(ByPosition((0.0,)), services) == []


def test_services_that_wait_for_each_other_stop_the_world():
    first, second = Filter(), Filter()
    first.topics, first.publishes = ("one",), ("two",)
    second.topics, second.publishes = ("two",), ("one",)
    members = {"a": Member("a", first), "b": Member("b", second)}
    with pytest.raises(WorldStopped, match="a, b wait for each other's readings"):
        answers_of(members, lambda member: [])


def test_what_regions_have_saved_is_that_of_one_coordinator():
    whole = {"agents": agent_lines({"a": "1", "b": "", "c": "x\ty"}), "count": 5}
    parts = [
        own_parts({"s": whole}, ["s"], Units([(n,) for n in range(2)], pieces), number)["s"]
        for number, pieces in enumerate([nodes("c", "d"), nodes("a", "b")])
    ]
    assert [each["count"] for each in parts] == [5, 0]
    assert joined_parts(parts) == whole


def nodes(*names):
    return tuple(AgentNode("AWalker", name) for name in names)
