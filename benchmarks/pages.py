"""What members in browser pages cost: CPU and duration of a frame, by their number.

    python -m benchmarks.pages [--members 0 10 50 200] [--role viewer] [--views 2] [--json]

Chromium opens pages of the view `page`; each page is up to 50 members besides itself, each with a
link, a name and a session of its own, because 200 tabs need more memory than most machines have.
`viewer`: each member draws --views per second of a world of six snails with 20 frames per second.
`host`: the members share 200 snails, each frame waits for all of them, and the next one follows at
once. Needs chromium and playwright.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from benchmarks.command import Option, Table, options
from minerva_bus.errors import BusError
from minerva_bus.runtime.operator_client import Client

PHONE = Path(__file__).parents[1] / "members" / "javascript" / "examples" / "phone"
IN_PAGE = 50
PATIENCE = 120.0
RATE = 20
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
TICKS = os.sysconf("SC_CLK_TCK")
MODULE = """
import {{ device }} from "minerva-bus";

import {{ snails }} from "./snails.js";

const viewer = () => device({{ draws: ["ePicture"], rate: {views}, draw() {{}} }});
const role = {{ viewer, host: () => snails }}[{role!r}];
export default Object.fromEntries({names!r}.map((name) => [name, role()]));
"""


def world(folder: Path, role: str, names: list[str], views: float) -> Path:
    """Write the world and its module; returns the world file."""
    for path in PHONE.iterdir():
        shutil.copy(path, folder)
    # Without rain and heat, no snail is born or dies, and the world does not end.
    code = (PHONE / "phone.py").read_text(encoding="utf-8").replace("[eSun(), eRain()]", "[eSun()]")
    (folder / "phone.py").write_text(code.replace("[eSun()]", "[eSun(0.0)]"))
    (folder / "members.js").write_text(MODULE.format(role=role, names=names, views=views))
    text = (PHONE / "phone.toml").read_text(encoding="utf-8").replace("garden.js", "members.js")
    text = text.replace("snails tilt-*", " ".join(names)).replace("elsewhere = true", "")
    if role == "host":
        agents = " · ".join(f"ASnail#s{number}<water=4>" for number in range(200))
        before, _, rest = text.partition('string = """')
        text = f'{before}string = "{agents}"{rest.partition(chr(34) * 3)[2]}'
        before, _, rest = text.partition("[process.snails]")
        text = before + rest[rest.index("[process.sky]") :]
    file = folder / "phone.toml"
    file.write_text(text)
    return file


def until(condition: Callable[[], Any], what: str) -> Any:
    """Wait for a condition."""
    end = time.monotonic() + PATIENCE
    while not (result := answered(condition)):
        if time.monotonic() > end:
            sys.exit(f"no {what} after {PATIENCE:g} s")
        time.sleep(0.1)
    return result


def answered(condition: Callable[[], Any]) -> Any:
    """The value of a condition; None while the world is too busy to answer."""
    try:
        return condition()
    except BusError:
        return None


def cpu(pid: int) -> float:
    """Seconds of processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def children(launcher: int) -> list[int]:
    text = Path(f"/proc/{launcher}/task/{launcher}/children").read_text()
    return [int(pid) for pid in text.split()]


def measure(role: str, members: int, seconds: float, views: float) -> dict[str, float]:
    """Run a world with this many members in pages, and measure it for some seconds."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        tabs = max(1, math.ceil(members / IN_PAGE))
        names = [f"m{number}-*" for number in range(math.ceil(members / tabs))]
        file = world(folder, role, names or ["unused-*"], views)
        rate = str(RATE) if role == "viewer" else "0"
        run = subprocess.Popen(
            [sys.executable, "-m", "minerva_bus.cli.main", "run", str(file), "--rate", rate],
            env={**os.environ, "MINERVA_RUNTIME_DIR": str(folder / "runtime")},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            assert run.stderr is not None
            line = next(line for line in run.stderr if "http://" in line)
            # Unread output would block the world.
            threading.Thread(target=run.stderr.read, daemon=True).start()
            url = line[line.index("http://") :].strip()
            endpoint = json.loads((folder / "runtime" / "phone.json").read_text())["endpoint"]
            with sync_playwright() as player:
                browser = player.chromium.launch(
                    executable_path=shutil.which("chromium"), args=FLAGS
                )
                opened = [browser.new_page() for _ in range(tabs)] if members else []
                for page in opened:
                    page.goto(url)
                figures = observed(
                    Client(endpoint, "phone"), run.pid, len(names) * len(opened), seconds
                )
                browser.close()
        finally:
            os.killpg(run.pid, signal.SIGTERM)
            run.wait()
    return figures


def observed(client: Client, launcher: int, members: int, seconds: float) -> dict[str, float]:
    """Wait until the members are present, then measure."""

    def present() -> bool:
        known = client.operator.status().members
        return (
            sum(member.name.startswith("m") and member.state == "present" for member in known)
            >= members
        )

    until(present, f"{members} members")
    server = next(
        member.pid for member in client.operator.status().members if member.name == "page"
    )
    coordinator = children(launcher)[0]
    time.sleep(2)
    began, frame = time.perf_counter(), client.operator.status().frame
    used = cpu(coordinator), cpu(server)
    time.sleep(seconds)
    frames = client.operator.status().frame - frame
    took = time.perf_counter() - began
    return {
        "members": members,
        "frames_per_second": frames / took,
        "coordinator_ms": 1000 * (cpu(coordinator) - used[0]) / max(frames, 1),
        "server_ms": 1000 * (cpu(server) - used[1]) / max(frames, 1),
    }


def main() -> None:
    given = options(
        __doc__,
        members=Option([0, 10, 50, 200], "numbers of members in pages"),
        role=Option("viewer", "what they are", ("viewer", "host")),
        views=Option(2.0, "views per second of a viewer"),
        seconds=10.0,
    )
    columns = {
        "members": ">8.0f",
        "frames_per_second": ">18.1f",
        "coordinator_ms": ">15.2f",
        "server_ms": ">10.2f",
    }
    table = Table(columns, as_json=given.json)
    for members in given.members:
        table.row(measure(given.role, members, given.seconds, given.views))


if __name__ == "__main__":
    main()
