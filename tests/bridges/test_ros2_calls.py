"""Services and parameters of a robot: figures of agents are requests, answers are events."""

import sys
from contextlib import closing, contextmanager

import numpy as np
import pytest

pytest.importorskip("rosbags")

from minerva_bus import EventType, Primitive, Vocabulary, WorldInfo
from minerva_bus.errors import MisuseError
from minerva_bus.world.services import View
from minerva_services.bridges.ros2 import Ros2Calls
from minerva_services.bridging.testing import RunningBridge
from tests.bridges.ros2_rig import ROBOT, free_endpoint
from tests.patience import patience

sys.path.insert(0, str(ROBOT.parent))
import node

PLight = Primitive("PLight", on=bool)
PFetch = Primitive("PFetch", what=str)
PSpeed = Primitive("PSpeed", speed=float)
eLight = EventType("eLight", ok=bool)
eFetched = EventType("eFetched", places=tuple[float, ...], first=str)
eSpeed = EventType("eSpeed", value=float)
eSet = EventType("eSet", parameter=str)
eCallFailed = EventType("eCallFailed", call=str, why=str)
ePicture = EventType("ePicture", visual=True)
VOCABULARY = Vocabulary.of(
    PLight, PFetch, PSpeed, eLight, eFetched, eSpeed, eSet, eCallFailed, ePicture
)
INFO = WorldInfo("w", VOCABULARY, 0, 0.1)
FETCH = "string what\nuint8 most\n---\nfloat64[] places\nFound[] found"
TYPES = {
    "std_srvs/msg/SetBool_Request": "bool data",
    "std_srvs/msg/SetBool_Response": "bool success\nstring message",
    "own_msgs/msg/Fetch_Request": FETCH.partition("\n---\n")[0],
    "own_msgs/msg/Fetch_Response": FETCH.partition("\n---\n")[2],
    "own_msgs/msg/Found": "string name",
    "rcl_interfaces/msg/GetParameters_Request": "string[] names",
    "rcl_interfaces/msg/GetParameters_Response": "ParameterValue[] values",
    "rcl_interfaces/msg/SetParameters_Request": "Parameter[] parameters",
    "rcl_interfaces/msg/SetParameters_Response": "SetParametersResult[] results",
}
LIGHT = {
    "service": "/light", "type": "std_srvs/srv/SetBool", "request": {"data": "{on}"},
    "event": "eLight", "data": {"ok": "success"}, "timeout": patience(5),
}  # fmt: skip
SET = {
    "node": "/base",
    "parameter": "speed",
    "value": "{speed}",
    "event": "eSet",
    "timeout": patience(5),
}
GET = {"node": "/base", "parameter": "speed", "event": "eSpeed", "timeout": patience(5)}


@pytest.fixture(scope="module", autouse=True)
def types():
    added = {}
    for name, text in TYPES.items():
        added |= node.get_types_from_msg(text, name)
    node.store.register(added)


@contextmanager
def calls(served, **options):
    """A robot that serves functions by service and type, and a function that shows figures."""
    endpoint = free_endpoint()
    robot = node.Ros(endpoint, 0)
    for (name, kind), answer in served.items():
        robot.serve(name, kind, answer)
    with closing(robot), calling(endpoint, **options) as ask:
        yield ask


@contextmanager
def calling(endpoint, **options):
    service = Ros2Calls(endpoint, **options)
    running = RunningBridge(service, INFO)

    def ask(text, count, frame=1):
        scene = VOCABULARY.read(text)
        service.show(View(frame, "ePicture", scene, {"r1": scene}))
        running.wait_for(lambda: len(running.emitted) >= count, f"{count} answers")
        return running.emitted[count - 1]

    with closing(service), running:
        yield ask


def light(query):
    on = node.read(query, "std_srvs/msg/SetBool_Request").data
    node.reply(query, "std_srvs/msg/SetBool_Response", success=on, message="")


SERVED = {("light", "std_srvs/srv/SetBool"): light}


def test_a_figure_is_a_request_and_a_change_is_another():
    with calls(SERVED, calls={"PLight": LIGHT}) as ask:
        first = ask("PLight<on=true>", 1)
        assert (first.type, first.values, first.receivers) == ("eLight", (True,), ("r1",))
        ask("PLight<on=true>", 1)
        assert ask("PLight<on=false>", 2).ok is False


def test_a_successor_does_not_repeat_a_request():
    scene = VOCABULARY.read("PLight<on=true>")
    service, successor = (Ros2Calls("tcp/h:7447", calls={"PLight": LIGHT}) for _ in range(2))
    asked = []
    for each in (service, successor):
        each.check(INFO)
        each.do = lambda *work: asked.append(work)
        if each is successor:
            each.restore(service.save())
        each.show(View(1, "ePicture", scene, {"r1": scene}))
    assert len(asked) == 1


def test_a_type_of_its_own_from_a_folder(tmp_path):
    def fetch(query):
        request = node.read(query, "own_msgs/msg/Fetch_Request")
        found = [node.make("own_msgs/msg/Found", name=request.what)]
        places = np.array([1.0, 2.0])
        node.reply(query, "own_msgs/msg/Fetch_Response", places=places, found=found)

    for path, text in {"srv/Fetch.srv": FETCH, "msg/Found.msg": "string name"}.items():
        file = tmp_path / "own_msgs" / path
        file.parent.mkdir(parents=True)
        file.write_text(text)
    call = {
        "service": "/fetch", "type": "own_msgs/srv/Fetch", "request": {"what": "{what}"},
        "event": "eFetched", "data": {"first": "found.0.name"},
    }  # fmt: skip
    served = {("fetch", "own_msgs/srv/Fetch"): fetch}
    with calls(served, calls={"PFetch": call}, definitions=str(tmp_path)) as ask:
        event = ask('PFetch<what="ball">', 1)
    assert event.values == ((1.0, 2.0), "ball")


def test_parameters_are_set_and_read():
    held = {"speed": 0.5}

    def value(number):
        fields = {f"{kind}_array_value": [] for kind in ("bool", "string")}
        arrays = {"byte": "uint8", "integer": "int64", "double": "float64"}
        fields |= {f"{kind}_array_value": np.zeros(0, of) for kind, of in arrays.items()}
        fields["bool_array_value"] = np.zeros(0, bool)
        about = {"bool_value": False, "integer_value": 0, "string_value": ""}
        kind = "rcl_interfaces/msg/ParameterValue"
        return node.make(kind, type=3, double_value=number, **about, **fields)

    def get(query):
        node.read(query, "rcl_interfaces/msg/GetParameters_Request")
        kind = "rcl_interfaces/msg/GetParameters_Response"
        node.reply(query, kind, values=[value(held["speed"])])

    def set_(query):
        (given,) = node.read(query, "rcl_interfaces/msg/SetParameters_Request").parameters
        assert (given.name, given.value.type) == ("speed", 3)
        fits = given.value.double_value < 1.0
        if fits:
            held["speed"] = given.value.double_value
        kind = "rcl_interfaces/msg/SetParametersResult"
        result = node.make(kind, successful=fits, reason="" if fits else "too fast")
        node.reply(query, "rcl_interfaces/msg/SetParameters_Response", results=[result])

    served = {
        ("base/get_parameters", "rcl_interfaces/srv/GetParameters"): get,
        ("base/set_parameters", "rcl_interfaces/srv/SetParameters"): set_,
    }
    with calls(served, calls={"PSpeed": SET, "PFetch": GET}) as ask:
        event = ask("PSpeed<speed=0.75>", 1)
        assert event.values == ("speed",)
        assert ask('PFetch<what="">', 2).value == 0.75
        assert "speed is refused: too fast" in ask("PSpeed<speed=2>", 3).why


def garbage(data):
    def answer(query):
        with query:
            query.reply(query.key_expr, data, attachment=query.attachment)

    return {("light", "std_srvs/srv/SetBool"): answer}


@pytest.mark.parametrize(
    ("served", "why"),
    [
        ({}, "nobody serves /light of std_srvs/srv/SetBool; start its node"),
        ({("lamp", "std_srvs/srv/SetBool"): light}, "the robot has /lamp"),
        ({("light", "std_srvs/srv/Trigger"): light}, "it is of std_srvs/srv/Trigger"),
        ({("light", "std_srvs/srv/SetBool"): lambda query: None}, "/light does not answer"),
        (garbage(b"\0"), "1 bytes are not a std_srvs/msg/SetBool_Response"),
        (garbage(b""), "0 bytes are not a std_srvs/msg/SetBool_Response"),
        (garbage(bytes(2 << 20)), "has 2097152 bytes, at most 1048576 are read"),
    ],
)
def test_a_request_without_an_answer_fails_in_time(served, why):
    # Long enough to see what the network has.
    with calls(served, calls={"PLight": LIGHT | {"timeout": patience(1)}}) as ask:
        event = ask("PLight<on=true>", 1)
    assert (event.type, event.call, event.receivers) == ("eCallFailed", "PLight", ("r1",))
    assert why in event.why


def test_a_robot_that_is_off_fails_in_time():
    with calling(free_endpoint(), calls={"PLight": LIGHT | {"timeout": patience(4)}}) as ask:
        assert "no ROS 2 network answers" in ask("PLight<on=true>", 1).why


@pytest.mark.parametrize(
    ("call", "why"),
    [
        ({"PLamp": LIGHT}, "no primitive PLamp"),
        ({"PLight": "x"}, "must be a table with service, type, event"),
        ({"PLight": LIGHT | {"servic": 1}}, "no 'servic'; did you mean 'service'"),
        ({"PLight": LIGHT | {"type": "std_srvs/srv/Setbool"}}, "did you mean 'std_srvs/srv/SetBool'"),
        ({"PLight": LIGHT | {"type": "std_srvs"}}, "expected one such as std_srvs/srv/SetBool"),
        ({"PLight": LIGHT | {"event": "eLigt"}}, "no event type eLigt"),
        ({"PLight": LIGHT | {"data": {"ok": "succes"}}}, "it has no succes"),
        ({"PLight": LIGHT | {"data": {}}}, "needs ok"),
        ({"PLight": LIGHT | {"data": {"ok": "message"}}}, "ok as bool, but message is text"),
        ({"PLight": LIGHT | {"timeout": 0}}, "timeout is 0"),
        ({"PLight": LIGHT | {"timeout": True}}, "timeout is True"),
        ({"PLight": LIGHT | {"qos": "default"}}, "calls.PLight has no 'qos'"),
        ({"PLight": LIGHT | {"request": {"date": 1}}}, "no field date; did you mean 'data'"),
        ({"PLight": LIGHT | {"request": {"data": "{off}"}}}, "the figure has no off"),
        ({"PLight": LIGHT | {"definition": "bool a"}}, "has 1 parts"),
        ({"PLight": LIGHT | {"type": "a/srv/B", "definition": "boool[ x\n---"}}, "cannot be read"),
        ({"PLight": LIGHT | {"type": "a/srv/B", "definition": "c/D x\n---"}}, "c/msg/D, which is not"),
        ({"PSpeed": {"node": "/base", "parameter": "p"}}, "event is missing"),
        ({}, "nothing to do"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_reported(call, why):
    with pytest.raises(MisuseError) as error:
        Ros2Calls("tcp/h:7447", calls=call).check(INFO)
    assert why in str(error.value)
    assert len(str(error.value).splitlines()) <= 10
