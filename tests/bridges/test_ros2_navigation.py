"""A robot that navigates by itself: goals are figures of agents, their ends are events."""

import sys
from contextlib import contextmanager
from dataclasses import replace

import pytest

pytest.importorskip("rosbags")

from minerva_bus import EventType, Metres, Primitive, Transformation, Vocabulary, WorldInfo
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.appearance import Motion
from minerva_bus.world.services import View
from minerva_services.bridges.ros2 import Ros2Navigation
from minerva_services.bridges.ros2.examination import _fit
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_rig import ROBOT, free_endpoint, network
from tests.patience import eventually, patience

sys.path.insert(0, str(ROBOT.parent))
import nav2
import node

PGoal = Primitive("PGoal", number=int)
TPlace = Transformation("TPlace", Motion("x", "y"), x=Metres, y=Metres)
eGoalFeedback = EventType("eGoalFeedback", number=int, at_x=Metres, distance=Metres)
eGoalResult = EventType("eGoalResult", number=int, end=str, why=str)
ePicture = EventType("ePicture", visual=True)
VOCABULARY = Vocabulary.of(PGoal, TPlace, eGoalFeedback, eGoalResult, ePicture)
INFO = WorldInfo("w", VOCABULARY, 0, 0.1)


class Drive:
    """A navigation service, its robot, and what an agent receives."""

    def __init__(self, endpoint, robot, info=INFO, saved=None, **options):
        self.endpoint, self.robot, self.frame = endpoint, robot, 0
        self.service = Ros2Navigation(endpoint, every=0.01, timeout=patience(1), **options)
        self.running = RunningBridge(self.service, info)
        if saved is not None:
            self.service.restore(saved)

    def __enter__(self):
        self.running.__enter__()
        return self

    def __exit__(self, *exc):
        self.service.close()
        self.running.__exit__(*exc)

    def show(self, *goals):
        """The view of a frame in which r1 has these goals: number, x and y."""
        self.frame += 1
        figures = (f"TPlace<x={x}, y={y}>(PGoal<number={number}>)" for number, x, y in goals)
        scene = VOCABULARY.read(" · ".join(figures))
        self.service.show(View(self.frame, "ePicture", scene, {"r1": scene}))

    def results(self, count):
        """The first ends of goals."""
        seen = lambda: [e for e in self.running.emitted if e.type == "eGoalResult"]  # noqa: E731
        self.running.wait_for(lambda: len(seen()) >= count, f"{count} results")
        return seen()

    def ends(self, count):
        """Their numbers and words."""
        return [(event.number, event.end) for event in self.results(count)]

    def drives(self, number):
        """Wait until the robot has a goal, and drive a bit."""

        def hears():
            self.robot.drive(0.1)
            events = self.running.emitted
            # A goal that is near may end before its first feedback.
            types = ("eGoalFeedback", "eGoalResult")
            return any(e.type in types and e.number == number for e in events)

        self.running.wait_for(hears, f"feedback of goal {number}")


@contextmanager
def nav(kind=nav2.Navigation, **options):
    endpoint = free_endpoint()
    robot = kind(endpoint)
    try:
        with Drive(endpoint, robot, **options) as drive:
            yield drive
    finally:
        drive.robot.close()


def test_a_robot_drives_to_a_goal_and_its_agent_is_told():
    with nav() as drive:
        drive.show((1, 2.0, 1.0))
        drive.drives(1)
        drive.robot.drive(10.0)
        assert drive.ends(1) == [(1, "reached")]
        drive.show((1, 2.0, 1.0))
        drive.show((2, 2.0, 1.0))  # the same place again
        drive.drives(2)
        assert drive.ends(2)[1] == (2, "reached")
    first = drive.running.emitted[0]
    assert first.receivers == ("r1",)
    assert 0 < first.at_x < 2
    assert first.distance > 0


def test_its_subscription_has_the_quality_that_is_asked():
    with nav(qos={"feedback": "sensor_data"}) as drive:
        drive.show((1, 2.0, 1.0))
        drive.drives(1)
        replies = drive.robot.session.liveliness().get("@ros2_lv/**")
        tokens = [str(reply.ok.key_expr).split("/") for reply in replies]
    ours = {parts[9].rpartition("%")[2]: parts[12] for parts in tokens if parts[5] in ("SC", "MS")}
    usual = "::,10:,:,:,,"
    assert ours == {"send_goal": usual, "get_result": usual, "feedback": "2::,5:,:,:,,"}


def test_a_later_goal_replaces_an_earlier_one():
    with nav() as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.show((2, 1.0, 9.0))
        drive.drives(2)
        assert drive.ends(1) == [(1, "replaced")]
        drive.show()
        assert drive.ends(2)[1] == (2, "canceled")


def test_a_goal_that_another_client_replaces_is_aborted():
    with nav() as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.robot.end(nav2.ABORTED)
        assert drive.ends(1) == [(1, "aborted")]


def test_the_earlier_goal_is_canceled_if_a_later_one_is_rejected():
    with nav() as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.show((2, 99.0, 1.0))
        assert drive.ends(2) == [(2, "rejected"), (1, "canceled")]


def test_a_robot_has_one_goal_and_others_are_rejected():
    with nav() as drive:
        for _ in range(2):
            drive.show((1, 9.0, 1.0), (2, 2.0, 2.0), (1, 9.0, 1.0))
        drive.drives(1)
        drive.show((3, 3.0, 3.0), (1, 9.0, 1.0), (2, 2.0, 2.0))
        assert drive.ends(2) == [(2, "rejected"), (3, "rejected")]
        assert "the view has 3 figures PGoal, of r1" in drive.results(1)[0].why
        drive.show((2, 2.0, 2.0))
        assert drive.ends(3)[2] == (1, "canceled")
        drive.show()
        drive.show((2, 2.0, 2.0))
        drive.drives(2)


class Late(nav2.Navigation):
    """Answers about results only when it is allowed to."""

    allowed = False

    def answer(self):
        if self.allowed:
            super().answer()


def test_a_cancellation_may_come_too_late():
    with nav(Late) as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.robot.end(nav2.REACHED)
        drive.show()
        drive.running.wait_for(lambda: drive.service._goal.state == "canceling", "it cancels")
        drive.robot.allowed = True
        drive.robot.answer()
        assert drive.ends(1) == [(1, "reached")]


def test_a_robot_that_restarts_has_lost_its_goal():
    with nav() as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.robot.close()
        drive.robot = nav2.Navigation(drive.endpoint)
        (result,) = drive.results(1)
        assert (result.number, result.end) == (1, "lost")
        drive.show((2, 1.0, 1.0))
        drive.drives(2)


def test_a_robot_that_goes_has_lost_its_goal():
    with nav() as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.robot.close()
        (result,) = drive.results(1)
        assert result.end == "lost"
        assert "the robot may still drive" in result.why
        drive.show((2, 9.0, 1.0))
        assert drive.ends(2)[1] == (2, "lost")


def test_a_network_without_navigation_is_described():
    with network() as (endpoint, _), Drive(endpoint, None) as drive:
        drive.show((1, 9.0, 1.0))
        (result,) = drive.results(1)
    wanted = "nobody serves /navigate_to_pose/_action/send_goal of nav2_msgs/action/NavigateToPose"
    assert result.end == "lost"
    assert result.why.startswith(wanted)


def test_a_goal_without_feedback_is_canceled():
    with nav(silence=0.3) as drive:
        drive.show((1, 9.0, 1.0))
        (result,) = drive.results(1)
        assert (result.end, result.why) == ("lost", "no feedback for 0.3 s")
        eventually(lambda: nav2.CANCELED in drive.robot.ended.values(), "it is canceled")


class Faulty(nav2.Navigation):
    """Replies with given bytes to goals, or to questions about results."""

    accepts, result = None, None

    def on_goal(self, query):
        if self.accepts is None:
            super().on_goal(query)
            return
        with query:
            query.reply(query.key_expr, self.accepts, attachment=query.attachment)

    def tell_result(self, query, state):
        with query:
            query.reply(query.key_expr, self.result, attachment=query.attachment)


@pytest.mark.parametrize(
    ("accepts", "result", "why"),
    [
        (b"nonsense", None, "not a nav2_msgs/msg/Accepted"),
        (b"", None, "not a nav2_msgs/msg/Accepted"),
        (bytes(3 << 20), None, "has 3145728 bytes, at most 1048576 are read"),
        (None, b"\x00\x01\x00\x00\x04", "its result: 5 bytes"),
        (None, bytes(3 << 20), "has 3145728 bytes, at most 1048576 are read"),
    ],
)  # fmt: skip
def test_answers_that_are_wrong_end_a_goal(accepts, result, why):
    with nav(Faulty) as drive:
        drive.robot.accepts, drive.robot.result = accepts, result
        drive.show((1, 9.0, 1.0))
        if accepts is None:
            drive.drives(1)
            drive.robot.end(nav2.REACHED)
        (event,) = drive.results(1)
    assert event.end == "lost"
    assert why in event.why


class Humble(nav2.Navigation):
    """No hashes of types, an empty result, and less feedback."""

    def tell_result(self, query, state):
        empty = node.make("std_msgs/msg/Empty")
        node.reply(query, "nav2_msgs/msg/HumbleResult", status=state, result=empty)

    def publish(self, topic, value):
        _, publisher, _ = self.publishers[topic]
        data = bytes(node.store.serialize_cdr(value, self.publishers[topic][0]))
        publisher.put(data[:-8])


def test_a_robot_with_humble(monkeypatch):
    text = "int8 status\nstd_msgs/Empty result"
    node.store.register(node.get_types_from_msg(text, "nav2_msgs/msg/HumbleResult"))
    monkeypatch.setattr(node, "SERVICE_HASH", "TypeHashNotSupported")
    with nav(Humble) as drive:
        drive.show((1, 2.0, 1.0))
        drive.drives(1)
        drive.robot.drive(9.0)
        assert drive.ends(1) == [(1, "reached")]


class BesideDds(nav2.Navigation):
    """A zenoh-bridge-ros2dds beside a robot: plain keys, and one token for an action."""

    def key(self, topic, message):
        return topic

    def serve(self, service, kind, answer):
        self.subscribers.append(self.session.declare_queryable(service, answer))

    def announce(self, kind, key="", qos=""):
        if not self.tokens:
            about = f"@/{self.session.zid()}/@ros2_lv/AS/navigate_to_pose"
            kind = "nav2_msgs§action§NavigateToPose"
            self.tokens.append(self.session.liveliness().declare_token(f"{about}/{kind}"))


def test_a_robot_with_dds():
    with nav(BesideDds, layout="dds") as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.show()
        assert drive.ends(1) == [(1, "canceled")]


def test_a_successor_continues_with_the_goal():
    with nav() as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        goal = drive.robot.goal
        saved = drive.service.save()
        drive.service.close()
        with Drive(drive.endpoint, drive.robot, saved=saved) as successor:
            successor.show((1, 9.0, 1.0))
            successor.drives(1)
            assert drive.robot.goal == goal
            drive.robot.drive(20.0)
            assert successor.ends(1) == [(1, "reached")]


def test_a_robot_stops_when_its_world_ends():
    with nav(info=replace(INFO, ended=lambda: True)) as drive:
        drive.show((1, 9.0, 1.0))
        drive.drives(1)
        drive.service.close()
        assert list(drive.robot.ended.values()) == [nav2.CANCELED]


def test_what_does_not_fit_is_reported():
    service = Ros2Navigation("tcp/h:7447", figure="PGaol")
    with pytest.raises(MisuseError, match="no primitive PGaol; did you mean 'PGoal'"):
        service.check(INFO)
    for data, why in ({"ned": str}, "needs ned"), ({"end": int}, "end as int, but end is text"):
        lacking = Vocabulary.of(PGoal, EventType("eGoalFeedback"), EventType("eGoalResult", **data))
        with pytest.raises(MisuseError, match=f"eGoalResult .*{why}"):
            Ros2Navigation("tcp/h:7447").check(replace(INFO, vocabulary=lacking))


def test_doctor_tells_whether_a_robot_has_what_a_world_needs():
    with nav() as drive:
        (fits,) = _fit("navigation", drive.service)
    with network() as (endpoint, _):
        (lacks,) = _fit("navigation", Ros2Navigation(endpoint))
    assert fits[1] is True
    assert (lacks[1], lacks[2].partition(" of ")[0]) == (
        False, "nobody serves /navigate_to_pose/_action/send_goal",
    )  # fmt: skip
