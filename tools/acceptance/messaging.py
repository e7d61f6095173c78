"""MQTT: the bridge and a broker that judges what it receives, with faults between them."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from functools import partial
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from minerva_bus import EventType, Primitive, Transformation, View, Vocabulary, WorldInfo
from minerva_services.bridges.mqtt import Mqtt
from tools.acceptance.suite import MissingSuiteError, Result, Suite, judged

SECONDS = 30.0
"""Longest wait for what a case awaits."""

WORDS: Vocabulary = Vocabulary.of(
    EventType("eReading", number=int),
    EventType("ePicture", visual=True),
    Primitive("PLamp", number=int),
    Transformation("TRoom", room=str),
)
IN = {"in/{room}": {"event": "eReading", "receivers": ["{room}"]}}
OUT = {"PLamp": {"topic": "out/{room}", "payload": "{number}", "retain": True}}


class LateError(Exception):
    """What a case awaits does not come."""


def _await(condition: Callable[[], Any], what: str) -> None:
    """Wait until a condition holds. Raises LateError."""
    end = time.monotonic() + SECONDS
    while not condition():
        if time.monotonic() > end:
            raise LateError(f"{what}: not within {SECONDS:g} s")
        time.sleep(0.01)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class _Broker:
    """The broker of the suite in a process, which can be killed and started again."""

    def __init__(self, program: Path, folder: Path) -> None:
        self.port = _free_port()
        self._program, self._log = program, folder / f"{self.port}.log"
        self._settings = folder / f"{self.port}.conf"
        self._settings.write_text(f"loglevel debug\nlistener {self.port} 127.0.0.1\n")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it, and wait until it listens."""
        command = [sys.executable, self._program.name, "-c", str(self._settings)]
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                command, cwd=self._program.parent, stdout=log, stderr=log
            )
        _await(self._listens, "the broker listens")

    def kill(self) -> None:
        """Kill it: what it knows is lost."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def violations(self) -> Iterator[str]:
        """What it reported."""
        for line in self._log.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith(("ERROR", "Traceback")):
                yield f"the broker reports {line}"

    def _listens(self) -> bool:
        with suppress(OSError):
            # A complete connection of MQTT, because the broker reports others as violations.
            client = _client(self.port)
            client.disconnect()
            return True
        return False


def _client(port: int, *filters: str) -> Any:
    """Another client; `arrived` has topics and payloads in order."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    client: Any = Client(CallbackAPIVersion.VERSION2)
    client.arrived, ready = [], threading.Event()
    client.on_message = lambda _client, _data, message: client.arrived.append(
        (message.topic, message.payload)
    )
    client.on_connect = lambda *_: (
        client.subscribe([(filter, 2) for filter in filters]) if filters else ready.set()
    )
    client.on_subscribe = lambda *_: ready.set()
    client.connect("127.0.0.1", port)
    client.loop_start()
    _await(ready.is_set, "the other client is connected")
    return client


@contextmanager
def _other(port: int, *filters: str) -> Generator[Any]:
    client = _client(port, *filters)
    try:
        yield client
    finally:
        client.disconnect()
        client.loop_stop()


@contextmanager
def _bridge(port: int, **options: Any) -> Generator[tuple[Mqtt, list[Any]]]:
    """The bridge in a thread, and the events that it emits."""
    bridge = Mqtt(f"mqtt://127.0.0.1:{port}", **({"topics": IN, "publish": OUT} | options))
    bridge.joined(WorldInfo("acceptance", WORDS, 0, 0.1))
    stop, emitted = threading.Event(), []
    thread = threading.Thread(target=bridge.run, args=(emitted.append, stop))
    thread.start()
    try:
        _await(lambda: bridge.report()["source"] == "open", "the bridge is connected")
        yield bridge, emitted
    finally:
        stop.set()
        thread.join(SECONDS)


def _show(bridge: Mqtt, *numbers: int) -> None:
    """Show a lamp in each room; rooms have numbers, too."""
    lamps = " · ".join(
        f'TRoom<room="{room}">(PLamp<number={number}>)' for room, number in enumerate(numbers)
    )
    bridge.show(View(0, "ePicture", WORDS.read(lamps)))


def _numbers(emitted: Sequence[Any]) -> list[int]:
    return [event.number for event in emitted]


def _settled(client: Any, emitted: list[Any], number: int) -> Callable[[], bool]:
    """Whether the bridge has received this number, which is sent until then."""

    def arrived() -> bool:
        client.publish("in/room", str(number))
        return number in _numbers(emitted)

    return arrived


def _both_ways(broker: _Broker, port: int, qos: int) -> Iterator[str]:
    """Messages in both directions, through `port`; those of QoS 1 may arrive twice."""
    with _bridge(port, qos=qos) as (bridge, emitted), _other(broker.port, "out/#") as other:
        _await(_settled(other, emitted, -1), "the subscription")
        emitted.clear()
        for number in range(100):
            other.publish("in/room", str(number), qos)
        _await(lambda: 99 in _numbers(emitted), "the last message")
        received = [number for number in _numbers(emitted) if number >= 0]
        if (list(dict.fromkeys(received)) if qos == 1 else received) != list(range(100)):
            yield f"the messages arrived as {received}"
        for number in range(20):
            _show(bridge, number, number + 1)
            _await(lambda n=number: ("out/1", str(n + 1).encode()) in other.arrived, "a figure")
        if other.arrived[-1][0] not in ("out/0", "out/1"):
            yield f"unknown topics: {other.arrived}"


def _qos(qos: int, broker: _Broker) -> Iterator[str]:
    yield from _both_ways(broker, broker.port, qos)


def _slow(qos: int, broker: _Broker) -> Iterator[str]:
    with _Relay(broker.port, 3, 0.001) as relay:
        yield from _both_ways(broker, relay.port, qos)


def _retained(broker: _Broker) -> Iterator[str]:
    with _bridge(broker.port, qos=1) as (bridge, _):
        _show(bridge, 7, 8)
        _await(lambda: bridge.report().get("published") == 2, "two figures")
        with _other(broker.port, "out/#") as other:
            _await(lambda: len(other.arrived) == 2, "what was retained")
            if sorted(other.arrived) != [("out/0", b"7"), ("out/1", b"8")]:
                yield f"retained is {other.arrived}"


def _presence(broker: _Broker) -> Iterator[str]:
    with _other(broker.port, "here") as other, _Relay(broker.port) as relay:
        with _bridge(broker.port, status="here"):
            _await(lambda: other.arrived, "online")
        _await(lambda: len(other.arrived) == 2, "offline when it leaves")
        with _bridge(relay.port, status="here"):
            _await(lambda: len(other.arrived) == 3, "online again")
            relay.cut()
            _await(lambda: ("here", b"offline") in other.arrived[3:], "its last will")
            _await(lambda: other.arrived[-1][1] == b"online", "online after the cut")
        _await(lambda: other.arrived[-1][1] == b"offline", "offline at the end")
    yield from ()


def _kept(qos: int, broker: _Broker) -> Iterator[str]:
    options = {"client": "house", "keeps": True, "qos": qos}
    with _other(broker.port) as other:
        with _bridge(broker.port, **options) as (_, emitted):
            _await(_settled(other, emitted, -1), "the subscription")
        for number in range(20):
            other.publish("in/room", str(number), qos).wait_for_publish(SECONDS)
        with _bridge(broker.port, **options) as (_, emitted):
            _await(lambda: 19 in _numbers(emitted), "what was kept")
            received = [number for number in _numbers(emitted) if number >= 0]
            if received != list(range(20)):
                yield f"kept messages arrived as {received}"


def _restarted(qos: int, broker: _Broker) -> Iterator[str]:
    with _bridge(broker.port, qos=qos) as (bridge, emitted):
        for turn in range(3):
            _show(bridge, turn, 0)
            broker.kill()
            _await(lambda t=turn: bridge.report().get("failures", 0) > t, "the loss is noticed")
            _show(bridge, turn, turn + 1)
            broker.start()
            with _other(broker.port, "out/#") as other:
                wanted = {("out/0", b"%d" % turn), ("out/1", b"%d" % (turn + 1))}
                _await(lambda w=wanted, o=other: w <= {*o.arrived}, "the newest figures")
                _await(_settled(other, emitted, 1000 + turn), "messages after the restart")
    yield from ()


def _cut(qos: int, broker: _Broker) -> Iterator[str]:
    """The connection breaks, also within a packet, while messages go both ways."""
    with (
        _Relay(broker.port) as relay,
        _bridge(relay.port, qos=qos) as (bridge, emitted),
        _other(broker.port, "out/#") as other,
    ):
        for turn in range(5):
            relay.cut_after(40 + 7 * turn)
            before = bridge.report().get("failures", 0)
            number = 0
            while bridge.report().get("failures", 0) == before:
                _show(bridge, number, -number)
                other.publish("in/room", str(number), qos)
                number += 1
                if number > 10_000:
                    yield "the cut is not noticed"
                    return
                time.sleep(0.01)
            _await(_settled(other, emitted, 20_000 + turn), "messages after the cut")
        _show(bridge, 1, 2)
        _await(lambda: {*other.arrived} >= {("out/0", b"1"), ("out/1", b"2")}, "the last figures")


class _Relay:
    """Passes bytes between clients and the broker, in pieces, slowly, and can cut connections."""

    def __init__(self, port: int, piece: int = 4096, pause: float = 0.0) -> None:
        self._broker, self._piece, self._pause = port, piece, pause
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._left: int | None = None
        self._pairs: list[tuple[socket.socket, socket.socket]] = []

    def __enter__(self) -> _Relay:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self.cut()

    def cut(self) -> None:
        """Cut all connections."""
        pairs, self._pairs = self._pairs, []
        for each in (each for pair in pairs for each in pair):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def cut_after(self, size: int) -> None:
        """Cut when the client has sent this number of bytes more."""
        self._left = size

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                broker = socket.create_connection(("127.0.0.1", self._broker))
                self._pairs.append((client, broker))
                for ends in ((client, broker), (broker, client)):
                    threading.Thread(target=self._pass, args=(*ends, client), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket, client: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(self._piece):
                if source is client and self._left is not None:
                    data, self._left = data[: self._left], self._left - len(data)
                sink.sendall(data)
                if source is client and self._left is not None and self._left <= 0:
                    self._left = None
                    self.cut()
                time.sleep(self._pause)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


CASES: dict[str, Callable[[_Broker], Iterator[str]]] = {
    **{f"QoS {qos}": partial(_qos, qos) for qos in range(3)},
    **{f"QoS {qos}, slow and in pieces": partial(_slow, qos) for qos in range(3)},
    "retained figures": _retained,
    "presence and last will": _presence,
    **{f"QoS {qos}, kept while away": partial(_kept, qos) for qos in (1, 2)},
    **{f"QoS {qos}, broker killed": partial(_restarted, qos) for qos in range(3)},
    **{f"QoS {qos}, connection cut": partial(_cut, qos) for qos in range(3)},
}


def _problems(case: Callable[[_Broker], Iterator[str]], broker: _Broker) -> Iterator[str]:
    try:
        broker.start()
        with redirect_stdout(StringIO()):  # The log of the bridge.
            yield from case(broker)
    except LateError as error:
        yield str(error)
    finally:
        broker.kill()
    yield from broker.violations()


def _results(folder: Path) -> Iterator[Result]:
    if not find_spec("paho"):
        raise MissingSuiteError("it needs paho-mqtt: pip install 'minerva-bus[mqtt]'")
    with TemporaryDirectory(prefix="minerva-acceptance-") as logs:
        for name, case in CASES.items():
            broker = _Broker(folder / "startbroker.py", Path(logs))
            yield judged(name, [*_problems(case, broker)])


PAHO = Suite(
    "paho",
    "eclipse/paho.mqtt.testing",
    "interoperability",
    "the bridge `mqtt`: what the strict broker of the suite reports, also with faults",
    _results,
)
