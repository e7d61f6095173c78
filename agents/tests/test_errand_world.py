"""The robot's world file in one process: an errand from order to delivery."""

import floor_plans
import pytest
from errands import FILE

from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.vocabulary import eErrand, eInterrupt
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.metrics import OrderFates
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides


@pytest.fixture
def hall(tmp_path):
    """A hall of 6 m x 4 m with three markers, as options of the robot's world."""
    markers = {"desk": [5.3, 3.2], "door": [0.7, 0.8], "window": [0.7, 3.2]}
    plan = floor_plans.hall(tmp_path, start=[3.0, 2.0, 0.0], markers=markers)
    return {"map": plan, "objective": "window"}


class Run:
    """A world in one process, and all events of its frames."""

    def __init__(self, options):
        file = read_world_file(FILE, Overrides(options=options))
        self.algorithm = FrameAlgorithm(file.world)
        self.events = []
        self.digests = []
        members = [process.make_member() for process in file.processes]
        self.runner = InProcessRunner(self.algorithm, members, self._watch)
        self.runner.start()

    def _watch(self, instruction):
        if isinstance(instruction, s.FrameDone):
            self.events += single(instruction.record.events)
            self.digests.append(instruction.record.digest)

    def order(self, event):
        self.runner.handle(s.Publish(event))
        return self

    def to_the_end(self, frames):
        while self.runner.ended is None:
            assert self.algorithm.frame < frames
            self.runner.handle(s.Begin())
        return self

    def of(self, *types):
        return [(event.sender, event.type) for event in self.events if event.type in types]

    def parcels(self):
        nodes = [node for node in agents(self.algorithm.scene) if node.symbol == "AParcel"]
        return {node.id: AParcel.thaw(node) for node in nodes}


def test_an_errand_is_done_and_then_the_objective_which_ends_the_world(hall):
    run = Run(hall).order(eErrand("desk", "door")).to_the_end(600)
    assert run.runner.ended.reason == "every agent has sent eReached"
    assert run.of("eTake", "eTaken", "ePut", "eDelivered", "eGivenUp") == [
        ("r1", "eTake"), ("p1", "eTaken"), ("r1", "ePut"), ("r1", "eDelivered"),
    ]  # fmt: skip
    assert {name: parcel.marker for name, parcel in run.parcels().items()} == {
        "p1": "door", "p2": "door", "p3": "window",
    }  # fmt: skip
    assert [parcel.carrier for parcel in run.parcels().values()] == ["", "", ""]
    assert run.runner.ended.figures["collisions"] == 0


def test_an_errand_for_all_is_done_by_one_and_all_go_on(hall):
    run = Run({**hall, "robots": "2", "parcels": "desk"}).order(eErrand("desk", "door"))
    run.to_the_end(900)
    assert len(run.of("eTaken")) == len(run.of("eDelivered")) == len(run.of("eGivenUp")) == 1
    assert run.parcels()["p1"].marker == "door"


def test_parcels_are_nothing_to_a_robot_without_an_errand(hall):
    with_parcels, without = Run(hall), Run({**hall, "parcels": ""})
    for run in (with_parcels, without):
        run.to_the_end(400)
    assert with_parcels.algorithm.frame == without.algorithm.frame
    robots = [
        next(node for node in agents(run.algorithm.scene) if node.id == "r1")
        for run in (with_parcels, without)
    ]
    assert robots[0] == robots[1]


def test_the_same_errand_is_repeatable(hall):
    first, other = (Run(hall).order(eErrand("desk", "door")).to_the_end(600) for _ in range(2))
    assert first.digests == other.digests


def test_an_interrupted_robot_stops_and_both_orders_have_a_fate(hall):
    run = Run(hall)
    fates = OrderFates(run.algorithm.world.vocabulary)
    for order in (eErrand("desk", "door", receivers=["r1"]), eInterrupt(receivers=["r1"])):
        run.order(order)
        for _ in range(12):
            run.runner.handle(s.Begin())
        fates.judge(order, "anna", run.algorithm.frame - 12)
    (interrupted,) = [event for event in run.events if event.type == "eInterrupted"]
    fates.end_frame(run.algorithm.frame, [interrupted])
    states = {order.type: order.state for order in fates.changed_since(0)}
    assert states == {"eErrand": "failed", "eInterrupt": "done"}
    (robot,) = [agent for agent in agents(run.algorithm.scene) if agent.symbol == "ARobot"]
    state = robot.state
    assert [state[name] for name in ("objective", "later", "target")] == ["", "", ""]
    place = state["row"], state["column"]
    run.runner.handle(s.Begin())
    (robot,) = [agent for agent in agents(run.algorithm.scene) if agent.symbol == "ARobot"]
    assert (robot.state["row"], robot.state["column"]) == place
