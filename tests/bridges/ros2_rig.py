"""ROS 2 networks for tests: a Zenoh router on a free port, and the simulated robot."""

import json
import math
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import zenoh

from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from tests.patience import patience

ROBOT = Path(__file__).parents[2] / "worlds" / "minerva_worlds" / "ros2" / "ros_robot.py"


def router(listen="tcp/127.0.0.1:0", filters=()):
    """A Zenoh router with the configuration of rmw_zenohd, and its endpoint."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([listen]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")
    config.insert_json5("low_pass_filter", json.dumps(filters))
    session = zenoh.open(config)
    if not listen.endswith(":0"):
        return session, listen
    for reply in session.get(f"@/{session.zid()}/router", timeout=patience(5)):
        for locator in json.loads(reply.ok.payload.to_string())["locators"]:
            if locator.startswith("tcp/127.0.0.1"):
                return session, locator
    raise AssertionError("the router does not say where it listens")


@contextmanager
def network(filters=()):
    """Start a router; yields its endpoint and its session.

    `filters` are those of Zenoh: messages that it loses.
    """
    session, endpoint = router(filters=filters)
    try:
        yield endpoint, session
    finally:
        session.close()


def hall(folder, width=4.0, height=3.0, start=(1.0, 1.5, 0.0), markers=None):
    """Write the map of a rectangular hall with walls around it."""
    columns, rows = round(width * 20), round(height * 20)
    image = np.zeros((rows, columns), np.uint8)
    image[2:-2, 2:-2] = 254
    return _saved(folder, "hall", image, start, markers or {"door": [3.2, 1.5]})


class RosRobot:
    """The simulated robot of the examples, in its own process."""

    def __init__(self, plan, endpoint, *words):
        self.process = subprocess.Popen(
            [sys.executable, ROBOT, "--map", plan, "--listen", endpoint, "--trace", *words],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self.lines = []
        assert "on" in self.process.stdout.readline()
        self._thread = threading.Thread(target=self._gather, daemon=True)
        self._thread.start()

    def _gather(self):
        for line in self.process.stdout:
            self.lines.append(line)

    @property
    def place(self):
        """The last reported pose: x, y and degrees."""
        return tuple(map(float, self.lines[-1].split())) if self.lines else (math.nan,) * 3

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.process.kill()
        self.process.wait()
        self._thread.join()
        self.process.stdout.close()


RANGES = [0.5, 1.0, np.inf, np.nan, 0.01, 12.0]


def scan(frame="laser", ranges=RANGES):
    return messages().make(
        types.LASER_SCAN,
        header=messages().header(frame, 1_500_000_000), angle_min=-0.5, angle_max=0.5,
        angle_increment=0.2, time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=12.0,
        ranges=np.array(ranges, np.float32), intensities=np.zeros(0, np.float32),
    )  # fmt: skip


def transforms(yaw):
    make = messages()
    turned = make.pose(0.0, 0.0, yaw).orientation
    transform = make.make(
        "geometry_msgs/msg/TransformStamped",
        header=make.header("base_link", 0), child_frame_id="laser",
        transform=make.make(
            "geometry_msgs/msg/Transform", translation=make.vector(-0.04), rotation=turned
        ),
    )  # fmt: skip
    return make.make(types.TRANSFORMS, transforms=[transform])


def free_endpoint():
    """An unused endpoint that a process can listen on."""
    session, endpoint = router()
    session.close()
    return endpoint


def house(folder, start=(1.23, 1.47, 30.0), markers=None):
    """Write the map of a house of 8 × 6 m: four rooms, each with a door to the next."""
    free = np.zeros((160, 120), bool)  # cells of 0.05 m, [along x, along y]
    for left, right, low, high in (
        (2, 78, 2, 58), (82, 158, 2, 68), (72, 158, 72, 118), (2, 68, 62, 118),
        (78, 82, 20, 42), (110, 132, 68, 72), (68, 72, 84, 104),
    ):  # fmt: skip
        free[left:right, low:high] = True
    image = np.where(free.T[::-1], 254, 0).astype(np.uint8)
    markers = markers or {"bed": [1.75, 4.55], "desk": [5.35, 4.85]}
    return _saved(folder, "house", image, start, markers)


def _saved(folder, name, image, start, markers):
    rows, columns = image.shape
    picture = folder / f"{name}.pgm"
    picture.write_bytes(b"P5\n%d %d\n255\n" % (columns, rows) + image.tobytes())
    keys = {"image": picture.name, "resolution": 0.05, "origin": [0.0, 0.0, 0.0], "negate": 0}
    keys |= {"occupied_thresh": 0.65, "free_thresh": 0.196, "start": list(start)}
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(keys | {"markers": markers}))
    return path
