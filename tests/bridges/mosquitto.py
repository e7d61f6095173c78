"""A real broker for tests: mosquitto, on a free port."""

import shutil
import socket
import subprocess
import threading
from contextlib import contextmanager

import pytest

from tests.patience import eventually, patience

FOUND = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
needs_mosquitto = pytest.mark.skipif(FOUND is None, reason="mosquitto is not installed")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Mosquitto:
    """A broker that can be killed and restarted on the same port."""

    def __init__(self, folder, *settings):
        self.port = free_port()
        self.address = f"mqtt://127.0.0.1:{self.port}"
        self._file = folder / f"mosquitto-{self.port}.conf"
        lines = settings or ("allow_anonymous true",)
        self._file.write_text(
            f"listener {self.port} 127.0.0.1\nmax_queued_messages 0\n" + "\n".join(lines) + "\n"
        )
        self.process = None
        self.start()

    def start(self):
        self.process = subprocess.Popen(
            [FOUND, "-c", self._file], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        eventually(self._listens, "mosquitto listens")

    def _listens(self):
        assert self.process.poll() is None, "mosquitto has ended"
        try:
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
        except OSError:
            return False
        return True

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()

    @contextmanager
    def client(self, *topics, **tls):
        """Another client of the broker; `heard` has topics, payloads and retained flags."""
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        client = Client(CallbackAPIVersion.VERSION2)
        if tls:
            client.tls_set(**tls)
        client.heard, ready = [], threading.Event()
        client.on_message = lambda _c, _d, m: client.heard.append((m.topic, m.payload, m.retain))
        client.on_connect = lambda *_: client.subscribe([(t, 1) for t in topics or ("none",)])
        client.on_subscribe = lambda *_: ready.set()
        client.connect("127.0.0.1", self.port)
        client.loop_start()
        assert ready.wait(patience())
        try:
            yield client
        finally:
            client.disconnect()
            client.loop_stop()


@contextmanager
def running(service):
    """Run a bridge in a thread; yields the list of the events that it emits."""
    stop, heard, failed = threading.Event(), [], []

    def run():
        try:
            service.run(heard.append, stop)
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield heard
    finally:
        stop.set()
        thread.join(patience())
        assert not thread.is_alive()
        assert not failed, failed
