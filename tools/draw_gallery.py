"""Make the films of the gallery: `python -m tools.draw_gallery [NAME ...]`.

Each film is an animation in WebP, made of pictures of a run: `minerva run NAME --view svg` with all
pictures kept. It needs the extras picture, plot, mqtt and ros, and mosquitto for the house.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy
import paho.mqtt.client as mqtt
from PIL import Image, ImageOps

from minerva_analysis.plotting import COLORS, Plot, show_grid
from minerva_services.views.palette import PAPER

ROOT = Path(__file__).parents[1]
OUTPUT = ROOT / "docs" / "gallery"
WORLDS = ROOT / "worlds" / "minerva_worlds"
MAP = ROOT / "agents" / "minerva_agents" / "robot" / "plan" / "office.yaml"
MINERVA = [sys.executable, "-m", "minerva_bus.cli.main"]
WIDTH, SIZE_LIMIT = 560, 240_000
FRAME_MS, LAST_MS = 100, 2000
PORT = 18830


@dataclass(frozen=True)
class Film:
    """How a world is run: its arguments, frames between pictures, surroundings, and the view.

    `options`: further options of the view, such as `zoom=1.5`.
    """

    arguments: Sequence[str]
    every: int = 10
    around: Callable[[ExitStack], None] | None = None
    view: str = "svg"
    options: str = ""


def process(stack: ExitStack, *command: str) -> None:
    """Run a program until the film is made."""
    running = stack.enter_context(subprocess.Popen(command))
    stack.callback(running.terminate)


def rooms(stack: ExitStack) -> None:
    """A broker, and two rooms whose heaters obey and whose sensors publish."""
    process(stack, "mosquitto", "-p", str(PORT))
    air, heated = {"kitchen": 18.0, "bath": 21.0}, {"kitchen": False, "bath": False}
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)

    def command(_client: object, _data: object, message: mqtt.MQTTMessage) -> None:
        heated[message.topic.split("/")[1]] = message.payload in (b"ON", b"true", b"True")

    client.on_connect = lambda *_: client.subscribe("home/+/heater/set")
    client.on_message = command
    client.connect_async("localhost", PORT)
    client.loop_start()
    stopped = Event()
    stack.callback(client.loop_stop)
    stack.callback(stopped.set)

    def weather() -> None:
        while not stopped.wait(0.3):
            for room, celsius in air.items():
                air[room] = celsius + (0.5 if heated[room] else -0.3)
                client.publish(f"home/{room}/temperature", f"{air[room]:.1f}")

    Thread(target=weather, daemon=True).start()


def robot(stack: ExitStack) -> None:
    """A ROS 2 robot in the office."""
    program = WORLDS / "ros2" / "ros_robot.py"
    process(stack, sys.executable, str(program), "--map", str(MAP))


FAST = ["--in-process", "--rate", "0"]
FILMS = {
    "arm": Film([*FAST, "--frames", "450", "--boxes", "2"], 15, view="solids"),
    "crowd": Film([*FAST, "--frames", "400"]),
    "flock": Film([*FAST, "--frames", "240"], every=3),
    "forager": Film([*FAST], every=1),
    "house": Film(["--broker", f"mqtt://localhost:{PORT}", "--frames", "300"], 5, rooms),
    "meadow": Film([*FAST, "--frames", "640"]),
    "plants": Film([*FAST], every=1),
    "robot": Film([*FAST]),
    "robots": Film([*FAST, "--frames", "1201"], every=15),
    "ros2": Film(["--map", str(MAP)], 12, robot),
    "rover": Film([*FAST], 25, view="opengl"),
    "rubble": Film([*FAST, "--frames", "200", "--pieces", "250"], 5, view="solids"),
    "slime": Film([*FAST, "--frames", "200"]),
    "swarm": Film([*FAST, "--frames", "1400"], 40, view="opengl", options="zoom=1.1,elevation=38"),
    "traffic": Film([*FAST, "--frames", "400"], every=5),
    "village": Film([*FAST, "--frames", "260"]),
    "warehouse": Film([*FAST, "--frames", "600"]),
}


def pictures(name: str, film: Film, folder: Path) -> list[Image.Image]:
    """Run a world and load its pictures, in the order of frames."""
    file = folder / ("picture.png" if film.view == "opengl" else "picture.svg")
    # Windows have more room around the world, and texts of a fixed size.
    width = 2 * WIDTH if film.view == "opengl" else WIDTH
    view = f"{film.view}:path={file},frames=true,every={film.every},width={width}"
    view += f",{film.options}" * bool(film.options)
    with ExitStack() as stack:
        if film.around is not None:
            film.around(stack)
        run = [*MINERVA, "run", name, *film.arguments, "--view", view, "--quiet"]
        subprocess.run(run, check=True, cwd=folder)
    return [scaled(Image.open(path)) for path in sorted(folder.glob("*.png"))]


def scaled(image: Image.Image) -> Image.Image:
    """The image in the width of films."""
    height = round(image.height * WIDTH / image.width)
    return image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)


def epidemic() -> list[Image.Image]:
    """Pictures of examples/sir: the people, and the curve so far."""
    script = (
        "import json; from sir import *; done = run(world, frames=240, seed=7, collect=curves |"
        " {'x': Person.x.every(4), 'y': Person.y.every(4), 'ill': Person.sick.every(4),"
        " 'days': Person.days.every(4)});"
        " frames, people = done.table(), done.table('APerson');"
        " print(json.dumps([{k: [float(v) for v in t[k]] for k in t.columns if k != 'id'}"
        " for t in (frames, people)]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT / "examples" / "sir", check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    frames, people = json.loads(done.stdout)
    x, y, days = (numpy.array(people[key]).reshape(-1, 200) for key in ("x", "y", "days"))
    sick = numpy.array(people["ill"]).reshape(-1, 200) > 0

    def paint(at: int, figure: Any) -> None:
        place, curve = figure.subplots(1, 2)
        groups = {"healthy": ~sick & (days == 0), "sick": sick, "immune": ~sick & (days > 0)}
        for (name, rows), colour in zip(groups.items(), COLORS, strict=False):
            place.scatter(x[at][rows[at]], y[at][rows[at]], s=22, color=colour, label=name)
        place.set(xlim=(0, 20), ylim=(0, 20), xticks=[], yticks=[], aspect="equal")
        place.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, handletextpad=0.1)
        for key, colour in (("sick", COLORS[1]), ("immune", COLORS[2])):
            curve.plot(frames["frame"][: 4 * at + 1], frames[key][: 4 * at + 1], color=colour)
        curve.set(xlim=(0, 240), ylim=(0, 200), xlabel="frame", ylabel="people", box_aspect=1)
        show_grid(curve)

    drawn = []
    for at in range(len(x)):
        content, _ = Plot("sir", (6.5, 3.6), partial(paint, at))._repr_png_()
        drawn.append(scaled(Image.open(io.BytesIO(content))))
    return drawn


def level(images: Sequence[Image.Image]) -> list[Image.Image]:
    """The images in the height of the largest: a legend grows while a world runs."""
    size = WIDTH, max(image.height for image in images)
    return [ImageOps.pad(image, size, color=PAPER, centering=(0, 0)) for image in images]


def save(images: Sequence[Image.Image], path: Path) -> None:
    """Write an animation with the best quality that keeps it small."""
    images = level(images)
    for step, quality in product((1, 2, 4), (80, 60, 40)):
        # The last picture comes first: it is what a page shows that does not play the film.
        shown = [images[-1], *images[:-1:step]]
        times = [LAST_MS] + [FRAME_MS * step] * (len(shown) - 1)
        file = io.BytesIO()
        shown[0].save(
            file, "webp", save_all=True, append_images=shown[1:], duration=times, loop=0,
            quality=quality, method=4,
        )  # fmt: skip
        if file.tell() <= SIZE_LIMIT:
            break
    path.write_bytes(file.getvalue())
    print(f"{path}: {len(shown)} pictures, {file.tell()} bytes, quality {quality}", flush=True)


def main() -> None:
    """Make the films of these worlds, or all."""
    names = sys.argv[1:] or [*FILMS, "sir"]
    if unknown := {*names} - {*FILMS, "sir"}:
        sys.exit(f"no film {', '.join(sorted(unknown))}; there are {', '.join(FILMS)} and sir")
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            images = epidemic() if name == "sir" else pictures(name, FILMS[name], Path(folder))
        save(images, OUTPUT / f"{name}.webp")


if __name__ == "__main__":
    main()
