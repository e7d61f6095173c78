"""The end of a world in regions: services have seen what one coordinator shows them, and report it."""

import pytest
from running import World, eventually, here, minerva, summary, write_world

LOOKING = """
from yard import *
from minerva_bus.world.halo import AGENTS, Halo, agent_lines, by_agent

class Tower(Generator, Device, draws=("eShow",), coupled=True):
    def __init__(self, every=1):
        self.every, self.views, self.total, self.asked = every, 0, 0, 0

    def show(self, view):
        self.views += 1
        self.total += sum(round(1000 * node.parameters["x"]) for node in view.scene)

    def generate(self, tick):
        self.asked += 1
        return ()

    def save(self):
        return {"views": self.views, "total": self.total, "asked": self.asked}

    def restore(self, saved):
        self.views, self.total, self.asked = saved["views"], saved["total"], saved["asked"]

    def report(self):
        return {"views": self.views, "total": self.total, "asked": self.asked}


class Near(Tower, draws=("eNear",)):
    halo = Halo(1.0)

    def __init__(self, every=1):
        self.every, self.seen = every, {}

    def show(self, view):
        own = None if self.own is None else {*self.own.ids}
        for node in view.scene:
            who, x = node.parameters["who"], round(1000 * node.parameters["x"])
            if own is None or who in own:
                self.seen[who] = self.seen.get(who, 0) + x

    def generate(self, tick):
        return ()

    def save(self):
        return {AGENTS: agent_lines({who: str(x) for who, x in self.seen.items()})}

    def restore(self, saved):
        self.seen = {who: int(x) for who, x in by_agent(saved[AGENTS]).items()}

    def report(self):
        return {"near": sum(self.seen.values())}


class Wanderer(Agent, symbol="AWanderer"):
    x: Metres = 0.0

    @on("eStep")
    def go(self, step, moment):
        self.x += 2 * moment.random.normal()
        if moment.number == 7 + "abcdef".index(self.id):
            moment.emit(eWish(0.0, "", receivers=["c"]))

    @view("eShow")
    def picture(self, event):
        return PDot(self.x)

    @view("eNear")
    def figure(self, event):
        return PFigure(self.x, 0.0, self.id)


PFigure = Primitive("PFigure", x=Metres, y=Metres, who=str)
eNear = EventType("eNear", visual=True)
vocabulary = Vocabulary.of(PDot, PFigure, eStep, eWish, eShow, eNear, Wanderer)
"""

MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.tower]
service = "looking:Tower"
every = {every}

[process.near]
service = "looking:Near"
every = {every}

[process.wanderers]
agents = "looking:Wanderer"
"""
STRING = " · ".join(f"AWanderer#{name}<x={x}>" for x, name in enumerate("abcdef"))
GRIDS = {1: "grid = { x = [] }", 2: "grid = { x = [2] }", 4: "grid = { x = [1, 2.5, 4] }"}
REPORTED = "frames", "digest", "ended", "views", "total", "asked", "near", "steps"


def world(folder, regions="", every=1, **settings):
    (folder / "looking.py").write_text(LOOKING)
    members = MEMBERS.format(every=every) + (f"\n[regions]\n{regions}\n" if regions else "")
    path = write_world(folder, members, STRING, **settings)
    path.write_text(path.read_text().replace("yard:vocabulary", "looking:vocabulary"))
    return path


def reported(ended):
    return {name: ended[name] for name in REPORTED}


def in_process(path):
    words = "--rate", 0, "--json", "--in-process"
    return reported(summary(here(path.parent, "run", path, *words)))


@pytest.mark.parametrize(
    ("frames", "every", "until"), [(12, 1, ""), (13, 3, ""), (14, 3, ""), (0, 1, "eWish")]
)
def test_services_report_what_they_report_with_one_coordinator(tmp_path, frames, every, until):
    given = {"every": every, "frames": frames, **({"until": until} if until else {})}
    single = in_process(world(tmp_path, **given))
    assert single["views"] == (single["frames"] - 1) // every + 2  # The last string, too.
    for regions in ("count = 2", GRIDS[4], f"{GRIDS[2]}\nhalo = true", f"{GRIDS[4]}\nhalo = true"):
        assert in_process(world(tmp_path, regions, **given)) == single
    for regions in (f"{GRIDS[4]}\nhalo = true", "count = 3")[: 2 if every == 1 else 1]:
        done = minerva(tmp_path, "run", world(tmp_path, regions, **given), "--rate", 0, "--json")
        assert reported(summary(done)) == single


@pytest.mark.parametrize("regions", ["count = 3", f"{GRIDS[4]}\nhalo = true"])
def test_services_have_seen_the_last_frame_of_a_world_that_is_stopped(tmp_path, regions):
    path = world(tmp_path, regions, frames=0)
    with World(path, "--rate", 50, "--json") as running:
        eventually(lambda: running.members() and running.frame > 5, "some frames")
        paused = summary(here(tmp_path, "pause", "--json"))["frame"]
        assert here(tmp_path, "stop").returncode == 0
        ended = reported(running.summary())
    assert ended["frames"] == ended["views"] == ended["asked"] == paused
    single = in_process(world(tmp_path, frames=paused))
    assert ended["digest"] == single["digest"]
    assert ended["total"] != single["total"]  # It has seen the last string, too.
    before = in_process(world(tmp_path, frames=paused - 1))
    assert {name: ended[name] for name in ("views", "total", "near")} == {
        name: before[name] for name in ("views", "total", "near")
    }
