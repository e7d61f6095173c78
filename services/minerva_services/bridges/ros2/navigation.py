"""A robot that navigates by itself: a figure of its agent is the goal of Nav2's NavigateToPose.

An action of ROS 2 consists of three services and two topics: `send_goal` accepts or rejects a goal,
`get_result` answers when it has ended, `cancel_goal` ends it, and `feedback` tells how it goes. The
topic `status` contains nothing that these do not tell.
"""

from __future__ import annotations

import math
import threading
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Type
from minerva_bus.world.services import View, WorldInfo
from minerva_services.bridges.ros2.client import PLACE, RobotClient, check_primitive, figures_of
from minerva_services.bridges.ros2.graph import SEND_GOAL, Announced
from minerva_services.bridges.ros2.layout import Ros2Network, check_name
from minerva_services.bridges.ros2.network import Answer, Ros2Session
from minerva_services.bridges.ros2.uses import TopicUse, missing_server, topic_uses
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.definitions import (
    DEGREES,
    METRES,
    SECONDS,
    MessageEvents,
    built,
    register,
    service_type,
)
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.ros_messages.readings import place_of
from minerva_services.bridging.bridge import SourceError, log
from minerva_services.event_factory import event_type
from minerva_services.options import check_positive, names_in, takes_options

_ACTION: Final = "nav2_msgs/action/NavigateToPose"
_GOAL = "unique_identifier_msgs/UUID goal_id\ngeometry_msgs/PoseStamped pose\nstring behavior_tree"
_FEEDBACK: Final = (
    "unique_identifier_msgs/UUID goal_id\ngeometry_msgs/PoseStamped current_pose\n"
    "builtin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\n"
    "int16 number_of_recoveries\nfloat32 distance_remaining"
)
_FEEDBACK_MESSAGE: Final = f"{_ACTION}_FeedbackMessage"
_MESSAGES: Final = {
    # In CDR, a message within another is the same as its fields.
    "nav2_msgs/msg/Goal": _GOAL,
    "nav2_msgs/msg/Accepted": "bool accepted\nbuiltin_interfaces/Time stamp",
    "nav2_msgs/msg/Asked": "unique_identifier_msgs/UUID goal_id",
    "nav2_msgs/msg/Result": "int8 status\nuint16 error_code\nstring error_msg",
    "nav2_msgs/msg/ResultWithCode": "int8 status\nuint16 error_code",
    "nav2_msgs/msg/ResultOfHumble": "int8 status\nstd_msgs/Empty result",
    _FEEDBACK_MESSAGE: (
        f"{_FEEDBACK}\nfloat32 position_tracking_error\nfloat32 heading_tracking_error"
    ),
    "nav2_msgs/msg/FeedbackUntilKilted": _FEEDBACK,
}  # fmt: skip
RESULTS: Final = (
    "nav2_msgs/msg/Result",
    "nav2_msgs/msg/ResultWithCode",
    "nav2_msgs/msg/ResultOfHumble",
)
FEEDBACKS: Final = (_FEEDBACK_MESSAGE, "nav2_msgs/msg/FeedbackUntilKilted")
"""Types of the versions, the newest first. Their sizes differ."""

_PLAIN: Final = ("bool", "int", "real", "text")
"""Kinds of the figure's values that belong to a goal."""

_PLACE_TYPES: Final = {"x": METRES, "y": METRES, "angle": DEGREES}
_PROGRESS: Final = {
    **{f"at_{name}": kind for name, kind in _PLACE_TYPES.items()},
    "distance": METRES, "seconds": SECONDS, "remaining": SECONDS, "recoveries": Type("int"),
}  # fmt: skip
_RESULT: Final = {"end": Type("text"), "why": Type("text"), "code": Type("int")}
"""Types of what events of feedback and results contain beside the goal."""

_ENDS: Final = {4: "reached", 5: "canceled", 6: "aborted"}
"""States of a goal that has ended [action_msgs/GoalStatus]; 0 is a goal that is not known."""

_DAY: Final = 86_400.0
"""Seconds for the answer about a result, which comes when the goal has ended."""

_REPLACED: Final = ("replaced", "a later goal has replaced it")
_RETRY_SECONDS: Final = 0.5
_LEAVE_SECONDS: Final = 1.0
_CANCEL_REFUSED: Final = 1


def navigation_messages() -> None:
    """Make the types of the action known."""
    register(_MESSAGES)


@dataclass(slots=True)
class NavigationGoal:
    """A goal as a view shows it, and how far it is.

    `state` is "new", "sent" (not accepted yet), "running" or "canceling". `until` is the end of the
    wait for the present answer, `heard` the time of the last feedback.
    """

    agent: str
    names: Mapping[str, Any]
    id: bytes = field(default_factory=lambda: uuid.uuid4().bytes)
    state: str = "new"
    until: float = math.inf
    heard: float = 0.0
    shown: float = -math.inf

    @property
    def key(self) -> tuple[Any, ...]:
        """What it is: a goal with another key is another one."""
        return self.agent, *sorted(self.names.items())


class Ros2Navigation(RobotClient):
    """Sends a robot that navigates by itself to where its agent's figure is.

    A figure that appears is a goal, one that moves or changes is a new goal, and one that goes
    cancels it. The agent receives how it goes, and how it ends.

    Args:
        router: the endpoint of the robot's network; its other options are those of `Ros2Network`.
        robot: the id of the agent; optional if there is only one with such a figure.
        figure: the primitive that is the goal, at its place; all its numbers belong to the goal.
        draws: the visual event type whose views contain it.
        action: the name of the action, of the type NavigateToPose.
        frame: the map frame, whose coordinates are those of the world.
        behavior: the behavior tree for the goals; "": that of the robot.
        feedback: the type of the events of feedback; "": none.
        result: the type of the event at the end.
        every: seconds between two events of feedback.
        timeout: seconds for an answer to a goal, or to its cancellation.
        silence: seconds without feedback after which a goal is canceled and lost.
        qos: the quality of service of `feedback`; services have none.

    """

    @takes_options(Ros2Network)
    def __init__(
        self,
        router: str,
        robot: str = "",
        figure: str = "PGoal",
        draws: str = "ePicture",
        action: str = "navigate_to_pose",
        frame: str = "map",
        behavior: str = "",
        feedback: str = "eGoalFeedback",
        result: str = "eGoalResult",
        every: float = 0.5,
        timeout: float = 5.0,
        silence: float = 30.0,
        qos: Mapping[str, Any] | None = None,
        **network: Any,
    ) -> None:
        super().__init__(Ros2Network(router, **network), "minerva_navigation", draws)
        check_name("an action", action)
        self._goals = f"{action}/{SEND_GOAL}", f"{_ACTION}_SendGoal"
        feedback_use = TopicUse("feedback", f"{action}/_action/feedback", _FEEDBACK_MESSAGE)
        (self._of_feedback,) = topic_uses(self.network, [feedback_use], qos)
        self._robot, self._figure, self._action = robot, figure, action
        self.concerns = names_in(robot)
        self._frame, self._behavior = frame, behavior
        self._feedback_event, self._result_event = feedback, result
        self._every = check_positive("ros2_navigation", "every", every)
        self._timeout = check_positive("ros2_navigation", "timeout", timeout)
        self._silence = check_positive("ros2_navigation", "silence", silence)
        self._wanted: NavigationGoal | None = None
        self._goal: NavigationGoal | None = None
        self._previous: NavigationGoal | None = None
        self._refused = set[tuple[Any, ...]]()
        self._events: list[Event] = []
        self._asked: tuple[Ros2Session, Announced] | None = None
        self._ask_after = 0.0
        self._wish: NavigationGoal | None = None

    def generates(self) -> tuple[str, ...]:
        """The event types of feedback and results."""
        return tuple(filter(None, (self._feedback_event, self._result_event)))

    def check(self, world: WorldInfo) -> None:
        """Raises MisuseError if rosbags is missing, or the world lacks the figure or the events."""
        navigation_messages()
        self._world = world
        check_primitive("ros2_navigation", world, self._figure)
        fields = world.vocabulary.primitives[self._figure].fields.all
        own = {each.name: each.type for each in fields if each.type.kind in _PLAIN}
        goal = {**_PLACE_TYPES, **own}
        self._feedback = None
        if self._feedback_event:
            self._feedback = self._made(world, self._feedback_event, {**goal, **_PROGRESS})
        self._result = self._made(world, self._result_event, {**goal, **_RESULT})

    def _made(self, world: WorldInfo, name: str, shape: Mapping[str, Type]) -> MessageEvents:
        declared = event_type("ros2_navigation", world, name)
        return MessageEvents("ros2_navigation", declared, {}, shape)

    # --- the world ---

    def show(self, view: View) -> None:
        """The goal of a view: the one that the robot has, otherwise the first.

        All others are rejected, once: a robot has one goal. They are not taken later, either.
        """
        shown = [
            NavigationGoal(agent, {name: value for name, value in names.items() if is_plain(value)})
            for agent, scene in sorted(view.parts.items())
            if agent not in view.halted and self._robot in ("", agent)
            for _, names in figures_of(scene, self._world.vocabulary, {self._figure: None})
        ]
        goals = {goal.key: goal for goal in shown}
        self._refused &= goals.keys()
        free = [goal for key, goal in goals.items() if key not in self._refused]
        had = self._wanted and self._wanted.key
        wanted = next((goal for goal in free if goal.key == had), free[0] if free else None)
        if (wanted and wanted.key) != had:
            self._wanted = wanted
            self.do(self._want, wanted)
        for goal in free:
            if goal is not wanted:
                self._refused.add(goal.key)
                self.do(self._end, goal, "rejected", self._several(shown))

    def _several(self, shown: Sequence[NavigationGoal]) -> str:
        agents = list(dict.fromkeys(goal.agent for goal in shown))
        remedy = f'; set robot = "{agents[0]}"' if len(agents) > 1 else ""
        return (
            f"a robot has one goal, but the view has {len(shown)} figures {self._figure}, of"
            f" {', '.join(agents)}{remedy}"
        )

    def save(self) -> Mapping[str, Any]:
        """The goal that the robot has, so that a successor neither repeats nor forgets it."""
        goal = self._goal or self._wanted
        if goal is None:
            return {}
        state = "running" if goal is self._goal else goal.state
        return {"agent": goal.agent, "names": dict(goal.names), "id": goal.id.hex(), "state": state}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Continue from a saved state: ask how the goal has gone meanwhile."""
        if not saved:
            return
        self._wanted = self._wish = goal = NavigationGoal(
            str(saved["agent"]), dict(saved["names"]), bytes.fromhex(saved["id"]),
            str(saved["state"]), heard=time.monotonic(),
        )  # fmt: skip
        if goal.state == "running":
            self._goal = goal

    # --- in its own thread ---

    def _want(self, wanted: NavigationGoal | None) -> None:
        self._wish = wanted
        if wanted is not None:
            # Also a goal that waits for the network, or for an answer about another one.
            wanted.until = time.monotonic() + self._timeout

    def servers(self) -> Sequence[tuple[str, str]]:
        """The service that accepts goals."""
        return [self._goals]

    def opened(self, session: Ros2Session) -> None:
        use = self._of_feedback
        session.subscribe(use.topic, use.message, partial(self.do, self._on_feedback), use.qos)

    def advance(self, session: Ros2Session | None) -> Iterator[Event]:
        now = time.monotonic()
        goal, wish = self._goal, self._wish
        if goal is not None:
            self._watch(goal, session, now)
        if goal is None or goal.state == "running":
            if wish is not None and wish.state == "new":
                self._begin(wish, session, now)
            elif goal is not None and (wish is None or wish.key != goal.key):
                self._cancel(goal, session, now)
        events, self._events = self._events, []
        yield from events

    def _begin(self, goal: NavigationGoal, session: Ros2Session | None, now: float) -> None:
        """Send a goal as soon as there is a server."""
        if session is None or session.server(*self._goals) is None:
            if now > goal.until:
                self._end(goal, "lost", self._absent(session))
            return
        place = [float(goal.names[name]) for name in PLACE]
        pose = messages().make(
            types.POSE_STAMPED,
            header=messages().header(self._frame, time.time_ns()), pose=messages().pose(*place),
        )  # fmt: skip
        request = messages().make(
            "nav2_msgs/msg/Goal", goal_id=_uuid(goal.id), pose=pose, behavior_tree=self._behavior
        )
        self._previous, self._goal = self._goal, goal
        goal.state, goal.until = "sent", now + self._timeout
        data = messages().encode("nav2_msgs/msg/Goal", request)
        answer = partial(self.do, self._on_accepted, goal)
        session.call(*self._goals, data, self._timeout, answer)

    def _on_accepted(self, goal: NavigationGoal, data: bytes | None, problem: str) -> None:
        if goal is not self._goal or goal.state != "sent":
            return
        previous, self._previous = self._previous, None
        accepted = False
        try:
            if not problem:
                accepted = bool(messages().decode("nav2_msgs/msg/Accepted", data or b"").accepted)
        except GarbageError as error:
            problem = f"its answer to the goal: {error}"
        if accepted:
            goal.state, goal.heard, goal.until = "running", time.monotonic(), math.inf
            self._asked, self._ask_after = None, 0.0
            if previous is not None:
                self._end(previous, *_REPLACED)
            return
        # A robot that still drives to the previous goal is stopped next: nobody wants it any more.
        self._goal = previous
        if problem:
            # It may have the goal without a word; then it must not drive.
            self._cancel_by_id(goal)
        end = ("lost", problem) if problem else ("rejected", "the robot rejects the goal")
        self._end(goal, *end)

    def _watch(self, goal: NavigationGoal, session: Ros2Session | None, now: float) -> None:
        """Ask for the result of a goal in each session and of each server; limit all waits."""
        if goal.state == "sent":
            if session is None:
                self._on_accepted(goal, None, self._absent(session))
            elif now > goal.until + _RETRY_SECONDS:
                self._on_accepted(goal, None, "the goal could not be sent")
            return
        server = session and session.server(*self._goals)
        asks = session and server and (session, server)
        if not asks:
            # A short loss of the network changes nothing: the robot goes on.
            goal.until = min(goal.until, now + self._timeout)
        elif goal.state == "running":
            goal.until = math.inf
        if now > goal.until:
            why = self._absent(session) if not asks else f"not canceled in {self._silence:g} s"
            self._end(goal, "lost", f"{why}; the robot may still drive")
        elif asks and asks != self._asked and now > self._ask_after:
            self._asked, self._ask_after = asks, now + _RETRY_SECONDS
            request = messages().make("nav2_msgs/msg/Asked", goal_id=_uuid(goal.id))
            data = messages().encode("nav2_msgs/msg/Asked", request)
            service, answer = f"{self._action}/_action/get_result", partial(self._on_result, goal)
            about = f"{_ACTION}_GetResult", data, _DAY, partial(self.do, answer)
            asks[0].call(service, *about)
        elif now - goal.heard > self._silence:
            self._cancel_by_id(goal)
            self._end(goal, "lost", f"no feedback for {self._silence:g} s")

    def _on_result(self, goal: NavigationGoal, data: bytes | None, problem: str) -> None:
        if goal is self._previous:
            self._end(goal, *_REPLACED)
        if goal is not self._goal:
            return
        if data is None:
            # Its server has gone, or is not there yet; `_watch` asks the next one.
            self._asked = None
            return
        try:
            if problem:
                raise GarbageError(problem)
            result = _decoded(RESULTS, data)
        except GarbageError as error:
            self._end(goal, "lost", f"its result: {error}")
            return
        code = getattr(result, "error_code", 0)
        why = getattr(result, "error_msg", "") or (f"error {code}" if code else "")
        if result.status in _ENDS:
            self._end(goal, _ENDS[result.status], why, code)
        else:
            self._end(goal, "lost", "the robot does not know the goal; has it restarted?")

    def _on_feedback(self, data: bytes) -> None:
        goal, now = self._goal, time.monotonic()
        try:
            feedback = _decoded(FEEDBACKS, data)
            if goal is None or bytes(feedback.goal_id.uuid) != goal.id:
                return  # of another client
            goal.heard = now
            if self._feedback is None or now - goal.shown < self._every or goal.state == "sent":
                return
            x, y, angle = place_of(feedback.current_pose.pose)
            values = {
                **goal.names, "at_x": x, "at_y": y, "at_angle": angle,
                "distance": float(feedback.distance_remaining),
                "seconds": _seconds(feedback.navigation_time),
                "remaining": _seconds(feedback.estimated_time_remaining),
                "recoveries": int(feedback.number_of_recoveries),
            }  # fmt: skip
            self._events.append(self._feedback(values, [goal.agent]))
            goal.shown = now
        except GarbageError as error:
            self.pass_over("garbage", f"ros2_navigation: feedback skipped: {error}")

    def _cancel(self, goal: NavigationGoal, session: Ros2Session | None, now: float) -> None:
        """Cancel the goal, and again if the answer is late; its end is in its result."""
        if session is not None:
            goal.state, goal.until = "canceling", now + self._silence
            self._send_cancel(session, goal, partial(self.do, self._on_cancel, goal))

    def _on_cancel(self, goal: NavigationGoal, data: bytes | None, problem: str) -> None:
        if goal is not self._goal or goal.state != "canceling":
            return
        try:
            if not problem:
                answer = messages().decode(_cancel_type().answer, data or b"")
                problem = "the robot refuses" if answer.return_code == _CANCEL_REFUSED else ""
        except GarbageError as error:
            problem = str(error)
        # A goal that has ended, or is not known, has a result that says so.
        if problem:
            self._end(goal, "lost", f"it cannot be canceled: {problem}")

    def _cancel_by_id(self, goal: NavigationGoal) -> None:
        """Cancel a goal that no longer counts, whatever the answer."""
        if self.session is not None:
            self._send_cancel(self.session, goal, lambda _, __: None)

    def _send_cancel(self, session: Ros2Session, goal: NavigationGoal, answer: Answer) -> None:
        kind = _cancel_type()
        request = built(kind.request, {"goal_info": {"goal_id": {"uuid": list(goal.id)}}})
        data = messages().encode(kind.request, request)
        service = f"{self._action}/_action/cancel_goal"
        session.call(service, kind.name, data, self._timeout, answer)

    def _absent(self, session: Ros2Session | None) -> str:
        if session is None:
            return f"{self.network.router}: {self.state}"
        return missing_server(session.graph, self.network, *self._goals)

    def _end(self, goal: NavigationGoal, end: str, why: str, code: int = 0) -> None:
        goal.state = "ended"
        self._goal = None if goal is self._goal else self._goal
        self._previous = None if goal is self._previous else self._previous
        self.count(end)
        values = {**goal.names, "end": end, "why": why, "code": code}
        try:
            self._events.append(self._result(values, [goal.agent]))
        except GarbageError as error:
            log(f"ros2_navigation: {self._result_event}: {error}; the goal is {end}: {why}")

    def close(self) -> None:
        """Leave the network; a robot must not drive on when its world has ended."""
        session = self.session
        if session is not None and self._goal is not None and self._world.ended():
            answered = threading.Event()
            with suppress(SourceError):
                self._send_cancel(session, self._goal, lambda _, __: answered.set())
                answered.wait(_LEAVE_SECONDS)
        super().close()


def is_plain(value: Any) -> bool:
    """Whether a value of a figure is part of a goal: a number or text, and no list or matrix."""
    return isinstance(value, bool | int | float | str)


def _decoded(kinds: Sequence[str], data: bytes) -> Any:
    """A message in CDR of the first type that fits. Raises GarbageError."""
    for kind in kinds[:-1]:
        try:
            return messages().decode(kind, data)
        except GarbageError:
            continue
    return messages().decode(kinds[-1], data)


def _cancel_type() -> Any:
    return service_type("action_msgs/srv/CancelGoal")


def _uuid(data: bytes) -> Any:
    return messages().make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(data, np.uint8))


def _seconds(duration: Any) -> float:
    return float(duration.sec + duration.nanosec * 1e-9)
