"""The Foxglove view, as a client of its WebSocket receives it."""

import importlib.util
import json
import socket
import struct
from contextlib import closing

import numpy as np
import pytest
from web_world import (
    FLOOR,
    PFloor,
    PMemory,
    PName,
    PWanted,
    PWay,
    cart,
    named,
    slot,
    taken_port,
    yard,
)

pytest.importorskip("foxglove", reason="needs foxglove-sdk (pip install 'minerva-bus[foxglove]')")
pytest.importorskip("websockets", reason="needs websockets (pip install 'minerva-bus[page]')")
from foxglove import messages as f
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from minerva_bus import MinervaError, View
from minerva_services.geometry.colors import rgb
from minerva_services.views.foxglove import Foxglove

WORLD = PFloor(FLOOR) + named("hall", 3.0, 2.0) + slot("ACart", "c")
WHITE = f.Color(r=1.0, g=1.0, b=1.0, a=1.0)
NO_TURN = f.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def address(device):
    return f"ws://127.0.0.1:{device._port.port}"


class Client:
    """A client that subscribes to every channel; protocol foxglove.sdk.v1."""

    def __init__(self, device, address):
        self._device = device
        self._socket = connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None)
        self._topics = {}

    def close(self):
        self._socket.close()

    def next(self, topic):
        """Time in nanoseconds and content of the next message of a channel."""
        # The test's time limit ends the loop.
        while True:
            self._device.pulse()
            try:
                message = self._socket.recv(timeout=0.02)
            except TimeoutError:
                continue
            if isinstance(message, str):
                self._subscribe(json.loads(message))
            elif message[0] == 1:
                subscription, time = struct.unpack_from("<IQ", message, 1)
                if self._topics[subscription] == topic:
                    return time, message[13:]

    def _subscribe(self, message):
        if message["op"] != "advertise":
            return
        wanted = [{"id": c["id"] + 100, "channelId": c["id"]} for c in message["channels"]]
        self._topics |= {c["id"] + 100: c["topic"] for c in message["channels"]}
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


@pytest.fixture
def device():
    made = Foxglove()
    made.joined(yard())
    yield made
    made.close()


@pytest.fixture
def client(device):
    with closing(Client(device, address(device))) as made:
        yield made


def view(frame, x, more=None):
    fragment = cart(x) if more is None else cart(x) + more
    return View(frame, "ePicture", WORLD, {"c": fragment})


def stamp(seconds):
    return f.Timestamp(int(seconds), round(seconds % 1 * 1e9))


def scenery(time, color):
    red, green, blue = color
    text = f.TextPrimitive(
        pose=f.Pose(position=f.Vector3(x=3.0, y=2.0, z=0.1), orientation=NO_TURN),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=f.Color(r=red, g=green, b=blue, a=1.0),
        text="hall",
    )
    return f.SceneEntity(timestamp=stamp(time), frame_id="world", id="scenery", texts=[text])


def test_it_prints_its_address(capsys):
    made = Foxglove()
    made.joined(yard())
    with closing(made):
        assert capsys.readouterr().out == f"{address(made)}\n"


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Origin": "http://["}, {"Origin": "null"}, {"Origin": "http://x"}],
)
def test_other_names_and_pages_of_other_sites_are_refused(device, headers):
    # The client writes the host of the address, which it does not look up.
    host, sock = headers.get("Host"), socket.create_connection(("127.0.0.1", device._port.port))
    options = {"additional_headers": {} if host else headers, "subprotocols": ["foxglove.sdk.v1"]}
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://{host or '127.0.0.1'}/", sock=sock, **options)
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("origin", ["", "file://", "https://app.foxglove.dev", "http://own:8080"])
def test_foxglove_itself_and_chosen_sites_may_connect(origin):
    made = Foxglove(origins="http://own:8080")
    made.joined(yard())
    headers = {"Origin": origin} if origin else {}
    options = {"additional_headers": headers, "subprotocols": ["foxglove.sdk.v1"]}
    with closing(made), connect(address(made), **options) as client:
        assert json.loads(client.recv())["op"] == "serverInfo"


def test_a_client_receives_the_latest_view_even_of_a_paused_world(device, client):
    device.show(view(7, 1.5))
    time, placed = client.next("/tf")
    assert time == 700_000_000
    expected = f.FrameTransform(
        timestamp=stamp(0.7),
        parent_frame_id="world",
        child_frame_id="c",
        translation=f.Vector3(x=1.5, y=0.0),
        rotation=NO_TURN,
    )
    assert placed == f.FrameTransforms(transforms=[expected]).encode()


def test_agents_and_scenery_are_entities(device, client):
    device.show(view(0, 1.5))
    _, update = client.next("/scene")
    radius, height = 0.2, device._overlay.picture().items[2].height[0]
    body = f.CylinderPrimitive(
        pose=f.Pose(position=f.Vector3(x=1.5, y=0.0, z=height / 2), orientation=NO_TURN),
        size=f.Vector3(x=2 * radius, y=2 * radius, z=height),
        bottom_scale=1.0,
        top_scale=1.0,
        color=f.Color(r=1.0, g=128 / 255, b=0.0, a=1.0),
    )
    assert body.encode() in update
    assert scenery(0.0, [share / 255 for share in rgb(PName.shape.color)]).encode() in update
    assert f.KeyValuePair(key="agent", value="c").encode() in update
    assert WHITE.encode() in update


def test_lines_marks_and_what_is_gone(device, client):
    device.show(view(0, 1.0, PWay((0.0, 1.0), (0.0, 0.0)) + PWanted("hall")))
    _, update = client.next("/scene")
    assert scenery(0.0, (1.0, 0.0, 1.0)).encode() in update
    assert f.Point3(x=1.0, y=0.0, z=float(np.float32(0.06))).encode() in update
    device.show(View(1, "ePicture", named("hall", 3.0, 2.0)))
    while (received := client.next("/scene"))[0] == 0:
        pass
    gone = f.SceneEntityDeletion(
        timestamp=stamp(0.1), type=f.SceneEntityDeletionType.MatchingId, id="c"
    )
    assert gone.encode() in received[1]


def test_matrices_are_sent_when_they_change_and_to_each_new_client(device, client):
    memory = PMemory(FLOOR)
    device.show(view(0, 1.0, memory))
    _, grid = client.next("/knowledge/c/1")
    # Rows of the matrix along x are columns of the grid; the three blue cells are half transparent.
    assert grid.count(bytes((0, 0, 255, 128))) == 3
    _, walls = client.next("/walls")
    assert b"/floor/1" in walls
    device.show(view(1, 2.0, memory))
    with closing(Client(device, address(device))) as other:
        assert other.next("/knowledge/c/1")[0] == 100_000_000


def test_ports_and_options_are_checked():
    taken, port = taken_port()
    with closing(taken):
        device = Foxglove(port=port)
        with pytest.raises(MinervaError, match=f"foxglove: port {port} .* is in use"):
            device.joined(yard())
    with pytest.raises(MinervaError, match="foxglove: port is 70000"):
        Foxglove(port=70000)
    with pytest.raises(MinervaError, match="foxglove: rate is 0"):
        Foxglove(rate=0)


def test_a_missing_library_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MinervaError, match=r"foxglove-sdk: .*minerva-bus\[foxglove\]"):
        Foxglove()
