"""The table [regions]: how agents are divided, and what is refused."""

import os
import time
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from minerva_bus import Agent, Device
from minerva_bus.errors import MisuseError, WorldFileError, WorldStopped
from minerva_bus.frame.member import Member
from minerva_bus.frame.members import Members
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.reading import read_world_file, read_world_text
from minerva_bus.launch.regions.layout import in_regions, unused_processes
from minerva_bus.launch.regions.run import RegionRun
from minerva_bus.launch.regions.unsupported import check_in_process, check_regions
from minerva_bus.launch.worldfile import Process
from minerva_bus.log.description import Description, decode_description, encode_description
from minerva_bus.regions.hosts import host_figures, hosts_in, without_hosts
from minerva_bus.regions.partition import ById, ByPosition
from minerva_bus.regions.region import Region
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.settings.overrides import Overrides
from minerva_bus.world.norms import Norm

# Also values on a border.
numbers = st.one_of(
    st.sampled_from([0.0, 0.5, 1.0, -0.0]), st.floats(-2, 2), st.sampled_from([float("inf")])
)
MEADOW = find_world("meadow")
TEXT = MEADOW.read_text(encoding="utf-8")


def read(table, **values):
    return read_world_text(f"{TEXT}\n[regions]\n{table}\n", MEADOW, Overrides(**values))


def rabbit(x, y):
    return AgentNode("ARabbit", "r", ("x", "y"), (x, y))


def test_a_grid_has_a_region_for_each_cell():
    partition = read("grid = { x = [8, 16], y = [7] }").partition
    assert partition.count == 6
    corners = [rabbit(x, y) for y in (0.0, 7.0) for x in (-1.0, 8.0, 99.0)]
    assert [partition.region_of(corner) for corner in corners] == list(range(6))


def test_a_grid_may_have_one_attribute():
    partition = read("grid = { y = [7] }").partition
    assert [partition.region_of(rabbit(0.0, y)) for y in (6.9, 7.1)] == [0, 1]


def test_a_tree_has_a_region_for_each_rectangle():
    partition = read("tree = { x = 8, below = { y = 4 }, above = { x = 16, above = { y = 2 } } }")
    partition = partition.partition
    points = [(0.0, 3.9), (7.9, 4.0), (8.0, 9.0), (16.0, 1.0), (99.0, 2.0)]
    assert partition.count == len(points)
    agents = [rabbit(*point) for point in points]
    assert [partition.region_of(agent) for agent in agents] == list(range(5))
    no_place = AgentNode("ARabbit", "r", ("x",), (1.0,))
    assert partition.region_of(no_place) == ById(5).region_of(no_place)


@given(st.lists(st.tuples(numbers, numbers), min_size=32, max_size=40))
@settings(max_examples=20, deadline=None)
def test_agents_in_columns_have_the_regions_of_nodes(points):
    nodes = tuple(
        AgentNode("ARabbit", f"r{n}", ("x", "y"), point) for n, point in enumerate(points)
    )
    (columns,) = packed(Scene(nodes)).pieces
    split = Split("x", 1.0, Split("y", 0.5, Split("x", 0.0)), Split("y", 1.0))
    for partition in (ByTree(split), ByPosition((0.0, 1.0), (0.5,))):
        regions = partition.regions_of(columns).tolist()
        assert regions == [partition.region_of(node) for node in nodes]


def test_the_command_line_replaces_the_number():
    assert read("count = 3", regions=5).partition.count == 5
    assert read("grid = { x = [8] }", regions=0).partition is None
    assert read_world_file(MEADOW).partition is None


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ("grid = { x = [9, 8] }", "grid must have ascending borders for x"),
        ("grid = { x = 8 }", "grid must have a list of numbers for x, not 8"),
        ("grid = { x = [nan] }", "grid must have a list of numbers for x"),
        ("grid = {}", "grid must have one or two attributes"),
        ("grid = { x = [8] }\ncount = 3", "count is 3, but the grid has 2 cells"),
        ("grid = { z = [8] }", "divides by z, which no agent kind has; attributes: "),
        ("tree = { x = 8, above = { yy = 8 } }", "divides by yy, which no agent kind has"),
        ("tree = {}", "tree must split at a number of one attribute"),
        ("tree = { x = 8, y = 3 }", "tree must split at a number of one attribute"),
        ("tree = { x = 8, below = { y = nan } }", "such as { x = 8 }, not {'y': nan}"),
        ("tree = { x = true }", "tree must split at a number"),
        ("tree = { x = 8, below = 3 }", "not 3"),
        ("count = 3\nbalance = 5", "balance moves the borders of regions by position: add grid"),
        ("tree = { x = 8 }\ncount = 3", "count is 3, but the tree has 2 cells"),
        ("tree = { x = 8 }\ngrid = { x = [8] }", "tree and grid are both given"),
        ("count = 257", "count must be at most 256"),
        ("cuont = 2", "cuont is unknown"),
        ('function = "meadow:Rabbit"', "function needs the number of regions"),
        ('count = 2\nfunction = "meadow:WIDTH"', "names meadow:WIDTH, which is not a function"),
        ('count = 2\nfunction = "meadow:none"', "meadow has no none"),
        ('count = 2\nlag = 1\nfunction = "meadow:Rabbit"', "lag needs regions by id, grid or tree"),
        ("grid = { x = [8] }\nlag = 1\nbalance = 9", "lag needs borders that stay where they are"),
        ("lag = 2", "lag is between regions: add count, grid or tree"),
        ("count = 2\nlag = -1", "lag must be at least 0"),
        ("count = 2\nmove_every = 3", "move_every lets regions run ahead by the lag between them"),
        ("count = 2\nlag = 1\nmove_every = 0", "move_every must be at least 1"),
        (
            'grid = { x = [8] }\nreach = "condition"\nlag = 1\nmove_every = 3',
            'move_every needs reach = "everywhere"',
        ),
    ],
)
def test_mistakes_are_named(table, problem):
    with pytest.raises(WorldFileError, match=problem):
        read(table)


@pytest.mark.parametrize(
    "table", ["count = 3", "grid = { x = [8], y = [3, 7] }", "tree = { x = 8, above = { y = 4 } }"]
)
def test_a_lag_is_that_of_the_file_with_one_coordinator_and_in_a_record(table):
    table += "\nlag = 2\nmove_every = 9"
    lag = read(table).world.lag
    assert (lag.frames, lag.every) == (2, 9)
    file = read(table, regions=0)
    assert (file.partition, file.world.lag) == (None, lag)
    description, _ = decode_description(encode_description(Description(file.world)))
    assert description.world.lag == lag


def test_one_region_has_no_lag():
    assert read("count = 3\nlag = 2", regions=1).world.lag is None


def ahead(file):
    with in_regions(file) as regions:
        notes = [note for note in regions.notes if note.startswith("regions")]
        return regions.processes[0].ahead, notes


@pytest.mark.parametrize(
    ("lag", "every", "frames"), [(3, 50, 3), (3, 3, 2), (1, 2, 1), (3, 1, 0), (0, 1, 0)]
)
def test_regions_run_ahead_by_their_lag_until_agents_move(lag, every, frames):
    file = read(f"count = 2\nlag = {lag}" + f"\nmove_every = {every}" * (every > 1))
    plural = "s" if frames > 1 else ""
    notes = [f"regions run up to {frames} frame{plural} ahead of each other"] if frames else []
    assert ahead(file) == (frames, notes)


class Eye(Device, coupled=True):
    made = 0

    def __init__(self):
        Eye.made += 1


class Screen(Device, draws=("eLook",)):
    rate = 5.0


class Rabbit(Agent, symbol="ARabbit"):
    pass


def test_what_needs_the_whole_world_keeps_regions_in_step():
    Eye.made = 0
    file = read("count = 2\nlag = 3\nmove_every = 9")
    norms = Norm("far", when="x > 3"), Norm("near", when="x > 3", where="#rabbit0.x < x")
    own, judged = (replace(file, world=replace(file.world, norms=norms[:n])) for n in (1, 2))
    shown = replace(file, processes=(*file.processes, Process("eye", Eye)))
    why = "regions wait for each other in each frame, because of "
    assert ahead(own)[0] == 3
    assert ahead(judged) == (0, [f"{why}norms that name other agents (near)"])
    assert ahead(shown) == (0, [f"{why}views and sensor topics (eye)"])
    assert Eye.made == 1


def test_processes_of_agents_that_regions_do_not_start_are_named():
    assert unused_processes(read("count = 2", processes=1).processes) == []
    names, effect = "foxes, ground, rabbits", "`processes` has no effect with regions"
    (note,) = unused_processes(read("count = 2", processes=3).processes)
    assert note.startswith(f"{names}: {effect}")


def test_hosts_are_tables_of_agents():
    file = read('count = 2\nhosts = ["rabbits"]')
    assert file.hosts == ("rabbits",)
    with in_regions(file) as regions:
        names = {each.name for each in regions.processes}
        hosts = {f"region-{n}.rabbits-{m}" for n in (0, 1) for m in (1, 2)}
        assert names == {"region-0", "region-1"} | hosts
        assert regions.world.expected == {"region-0", "region-1"}
        assert not any("no effect" in note for note in regions.notes)
    with pytest.raises(
        WorldFileError, match=r"hosts names no process of agents, 'rabbit'.*rabbits"
    ):
        read('count = 2\nhosts = ["rabbit"]')
    away = replace(file, processes=tuple(replace(p, elsewhere=True) for p in file.processes))
    with in_regions(away) as regions:
        assert {each.name for each in regions.processes} == {"region-0", "region-1"}


def test_hosts_whose_failure_is_ignored_and_commands_that_others_show_are_refused():
    file = replace(read("count = 2"), hosts=("rabbits", "snails"))
    ignored = Process("rabbits", table="rabbits", agents=(Agent,), on_failure="ignore")
    with pytest.raises(WorldFileError, match=r'hosts with on_failure = "ignore" \(rabbits\)'):
        check_regions(replace(file, processes=(ignored,)), ())
    snails = Process("snails", table="snails", command=("snails",))
    screen = Member("screen", Screen())
    with pytest.raises(WorldFileError, match=r"views \(screen\) with hosts that are .*\(snails\)"):
        check_regions(replace(file, processes=(snails,)), [screen])


def test_a_region_takes_hosts_of_agents_and_its_own_members():
    world = read("count = 2").world
    region = Region(world, 0, ById(2), [Member("eye", Eye())])
    objection = region.algorithm.source.objection
    assert objection(Member("eye", Eye()).hello()) == ""
    assert objection(Member("host", None, [Rabbit]).hello()) == ""
    assert "only hosts of agents" in objection(Member("other", Eye()).hello())
    assert "only hosts of agents" in objection(Member("none", None).hello())


def test_a_region_reports_its_hosts_and_no_others():
    members, whole = Members(["own", "region-0.a"]), Members(["region-0", "region-1"])
    host = members.get("region-0.a")
    members.introduce(host, Member("region-0.a", None, [Rabbit]).hello())
    figures = {**host_figures(members, ["own"]), "region-1.b/pid": 7, "flights": 3}
    whole.get("region-0").figures = figures
    (shown,) = hosts_in(whole)
    assert (shown.name, shown.kinds, shown.pid) == ("region-0.a", ("ARabbit",), os.getpid())
    assert without_hosts(figures) == {"flights": 3}


def test_a_norm_on_events_that_names_another_agent_is_refused():
    norm = Norm("near", on=("eBorn",), when="#rabbit0.x > 3")
    file = read("count = 4")
    file = replace(file, world=replace(file.world, norms=(norm,)))
    with pytest.raises(WorldFileError, match=r"norms on events.*\(near\).*--regions 0"):
        check_regions(file, ())


def test_rules_for_placement_apply_in_each_region():
    rules = '\n[placement]\nAFox = "nobody"\n'
    run = {"frames": 20, "rate": 0.0}
    file = read_world_text(f"{TEXT}{rules}[regions]\ncount = 3", MEADOW, Overrides(**run))
    regions, single = (
        each(file, Console(quiet=True), time.monotonic()).run()
        for each in (RegionRun, InProcessRun)
    )
    assert regions.digest == single.digest
    free = InProcessRun(read("", **run), Console(quiet=True), time.monotonic()).run()
    assert regions.digest != free.digest


@pytest.mark.parametrize(
    ("rule", "problem"),
    [
        ("agents_per_host = 9", "agents_per_host in .placement.; run it with one coordinator"),
        ('AFox = { near = "bell" }', "near a process outside of regions .bell."),
    ],
)
def test_placement_that_regions_cannot_keep_is_refused(rule, problem):
    bell = '[process.bell]\ncommand = ["true"]\n[placement]\n'
    with pytest.raises(WorldFileError, match=problem):
        read_world_text(f"{TEXT}\n{bell}{rule}\n[regions]\ncount = 2", MEADOW, Overrides())


def test_a_record_in_one_process_is_refused(tmp_path: Path):
    file = read("count = 2", record=str(tmp_path / "run.mcap"))
    with pytest.raises(WorldFileError, match=r"records .*; run its regions as processes"):
        check_in_process(file)


@pytest.mark.parametrize("balance", [0, 7])
def test_a_world_has_the_digest_of_one_coordinator(balance):
    run = {"frames": 30, "rate": 0.0}
    file = read(f"grid = {{ x = [8, 16], y = [7] }}\nbalance = {balance}", **run)
    console = Console(quiet=True)
    regions = RegionRun(file, console, time.monotonic()).run().plain()
    single = InProcessRun(file, console, time.monotonic()).run().plain()
    same = ("digest", "frames", "ended", "reached", "members")
    assert {name: regions[name] for name in same} == {name: single[name] for name in same}
    assert regions["regions"] == 6


def test_a_number_that_is_no_region_stops_the_world(monkeypatch):
    import meadow

    monkeypatch.setattr(meadow, "wrong", lambda name, state: 2, raising=False)
    file = read('count = 2\nfunction = "meadow:wrong"')
    with pytest.raises(WorldStopped) as stopped:
        RegionRun(file, Console(quiet=True), time.monotonic()).run()
    assert isinstance(stopped.value.__cause__, MisuseError)
    assert "returned 2 for #meadow; expected an integer from 0 to 1" in str(stopped.value)
