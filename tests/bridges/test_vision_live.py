"""Video streams and cameras that start, stop, return, or do not exist."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from mosquitto import eventually

from minerva_bus import Vocabulary, WorldInfo

cv2 = pytest.importorskip("cv2")
from rendered import FX, SIZE, rendered  # noqa: E402

from minerva_services.bridging import SourceError  # noqa: E402
from minerva_services.sensors.vision import Vision  # noqa: E402
from tests.patience import patience  # noqa: E402


class Camera(BaseHTTPRequestHandler):
    """A network camera: an endless stream of JPEG images while it is on."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        try:
            while not self.server.off.wait(0.02):
                if not self.server.silent.is_set():
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(self.server.image)}\r\n\r\n"
                    self.wfile.write(head.encode() + self.server.image + b"\r\n")
        except OSError:
            pass

    def log_message(self, *_):
        pass


@contextmanager
def camera(port=0, image=None):
    ThreadingHTTPServer.allow_reuse_address = True
    server = ThreadingHTTPServer(("127.0.0.1", port), Camera)
    server.daemon_threads = True
    server.image = image or cv2.imencode(".jpg", rendered(cv2, (5, 1.0, 0, 0, 0)))[1].tobytes()
    server.off, server.silent = threading.Event(), threading.Event()
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield server
    finally:
        server.off.set()
        server.shutdown()
        server.server_close()
        thread.join()


class Told(list):
    def publish(self, topic, reading):
        self.append((topic, reading))


def vision(source):
    service = Vision(str(source), dictionary="6X6_250", size=SIZE, robot="r", fx=FX)
    service.joined(WorldInfo("w", Vocabulary.of(), 0, 0.1))
    return service


@contextmanager
def running(service):
    stop, published = threading.Event(), Told()
    thread = threading.Thread(target=service.run, args=(published, stop))
    thread.start()
    try:
        yield published
    finally:
        stop.set()
        thread.join(patience(30))
        assert not thread.is_alive()


def test_a_stream_that_stops_and_resumes(capfd):
    with camera() as server:
        port = server.server_port
        service = vision(f"http://ann:secret@127.0.0.1:{port}/stream.mjpg")
        with running(service) as published:
            eventually(lambda: len(published) > 3, "it sees")
            assert published[0][1].seen[0].marker == "5"
            assert published[0][1].seen[0].distance == pytest.approx(1.0, rel=0.03)
            server.off.set()
            server.shutdown()
            server.server_close()
            eventually(lambda: service.report().get("failures"), "the loss is noticed")
            published.clear()
            with camera(port):
                eventually(lambda: published, "it sees again")
    said = capfd.readouterr().out
    assert "retrying" in said
    assert f"vision: http://127.0.0.1:{port}/stream.mjpg is back\n" in said
    assert "secret" not in said


def test_a_stream_that_falls_silent(monkeypatch):
    with camera() as server:
        monkeypatch.setattr("minerva_services.sensors.vision.images.IMAGE_SECONDS", 1.0)
        service = vision(f"http://127.0.0.1:{server.server_port}/")
        with running(service) as published:
            eventually(lambda: published, "it sees")
            server.silent.set()
            eventually(lambda: service.report().get("failures"), "the silence is noticed")
            published.clear()
            server.silent.clear()
            eventually(lambda: published, "it sees again")


@pytest.mark.parametrize(
    "source", ["77", "/dev/video77", "http://127.0.0.1:1/x", "rtsp://127.0.0.1:1/x"]
)
def test_a_camera_that_is_not_there(source, capfd):
    with pytest.raises(SourceError, match="cannot open") as lost:
        vision(source).open()
    assert source in str(lost.value)
    assert capfd.readouterr() == ("", "")


def test_a_stream_of_garbage(monkeypatch):
    monkeypatch.setattr("minerva_services.sensors.vision.images.IMAGE_SECONDS", 2.0)
    with camera(image=b"nonsense" * 100) as server:
        service = vision(f"http://127.0.0.1:{server.server_port}/")
        with running(service) as published:
            eventually(lambda: service.report().get("failures"), "it is no camera")
            assert published == []
