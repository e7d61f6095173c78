"""`minerva doctor`: check the environment for dependencies of worlds."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from types import MappingProxyType
from typing import Final

from minerva_bus.cli.output import print_json, print_result
from minerva_bus.entry_points import entries
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.wording import NO_VALUE, install

CHECKS: Final = "minerva.checks"
"""Entry points: functions of a source, which yield what they find, whether it is good, a note."""

LEAST: Final = (3, 11)

EXTRAS: Final = {
    "maps": (("yaml", "PIL"), "maps of the ROS map_server"),
    "picture": (("resvg_py", "PIL"), "PNG files of the svg view"),
    "sprites": (("pygame",), "a window in 2D"),
    "opengl": (("moderngl", "pygame"), "a window in 3D"),
    "web": (("viser",), "a page"),
    "page": (("websockets",), "pages that are members, also on phones"),
    "foxglove": (("foxglove",), "live views in Foxglove"),
    "rerun": (("rerun",), "recordings for Rerun"),
    "top": (("textual",), "the terminal dashboard"),
    "record": (("mcap",), "records of runs"),
    "plot": (("matplotlib",), "plots of records"),
    "neighbours": (("scipy",), "the service neighbours"),
    "fast": (("numba",), "compiled methods and spaces"),
    "space": (("rapier3d", "trimesh"), "bodies in three dimensions"),
    "wasm": (("rapier3d", "wasmtime"), "bodies with the same bits on all processors"),
    "tls": (("cryptography",), "certificates for remote members"),
    "profile": (("pyinstrument",), "flame graphs of members"),
    "mcp": (("mcp", "jsonschema"), "worlds for assistants"),
    "metrics": (("prometheus_client",), "figures for Prometheus"),
    "evolve": (("tomlkit",), "world files with an evolved string"),
    "sweep": (("pyarrow",), "tables of studies as .parquet"),
    "parquet": (("pyarrow",), "collected data as .parquet"),
    "pandas": (("pandas",), "collected data in pandas"),
    "polars": (("polars",), "collected data in Polars"),
    "notebook": (("anywidget", "ipykernel"), "live worlds in notebooks"),
    "rl": (("gymnasium", "pettingzoo"), "environments for reinforcement learning"),
    "onnx": (("onnxruntime",), "trained policies in ONNX files"),
    "dask": (("distributed",), "studies on a Dask cluster"),
    "video": (("av",), "films of runs"),
    "ros": (("rosbags", "PIL", "xxhash"), "ROS 2 robots, and bags"),
    "mqtt": (("paho",), "MQTT brokers"),
    "llm": (("httpx",), "servers of language models"),
    "serial": (("serial", "pynmea2"), "lidars and GPS on a serial line"),
    "vision": (("cv2",), "markers that cameras see"),
    "gamepad": (("pygame",), "gamepads"),
    "mosaik": (
        ("mosaik", "mosaik_api_v3"),
        "worlds in mosaik's scenarios, its simulators in worlds",
    ),
    "fmi": (("fmpy", "pythonfmu3"), "models as FMUs in worlds, worlds as FMUs"),
    "helics": (("helics",), "worlds as federates of HELICS"),
    "optuna": (("optuna",), "searches by a sampler of Optuna"),
    "lerobot": (("pyarrow", "PIL"), "data sets of LeRobot"),
    "spade": (("spade", "greenlet"), "agents of SPADE"),
}

GROUPS: Final = {
    "robots": ("maps", "picture", "record", "ros", "top", "web"),
    "models": ("fast", "neighbours", "picture", "plot", "record", "sweep"),
    "views": ("opengl", "page", "picture", "plot", "sprites", "top", "video", "web"),
    "sensors": ("gamepad", "mqtt", "ros", "serial", "vision"),
    "ml": ("lerobot", "onnx", "optuna", "rl"),
}
"""The extras that are groups for a task; what is in none of them is listed as `MORE`."""

MORE: Final = "more extras"


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check. `needed`: no world runs without it."""

    what: str
    good: bool
    note: str
    needed: bool = False


def examine(as_json: bool, sources: Mapping[str, str] = MappingProxyType({})) -> int:
    """Print the results; returns 1 if a required dependency is missing, otherwise 0.

    `sources` are those of installed checks, by their names, which are made in place of those of the
    environment. Raises MisuseError for an unknown name.
    """
    findings = [each for name in sources for each in _checked(name, sources[name])]
    findings = findings or list(_findings())
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        shown = [finding for finding in findings if finding.what not in EXTRAS]
        # A specific check has no extras.
        shown += [] if sources else _by_group(findings)
        width = max(len(finding.what) for finding in shown)
        for finding in shown:
            mark = "✓" if finding.good else ("✗" if finding.needed else "–")
            print_result(f"{mark} {finding.what.ljust(width)}  {finding.note}")
    return 0 if all(finding.good for finding in findings if finding.needed) else 1


def _checked(name: str, source: str) -> Iterator[Finding]:
    checks = entries(CHECKS)
    if name not in checks:
        known = f"; installed checks are {', '.join(sorted(checks)) or 'none'}"
        raise MisuseError(f"doctor has no option --{name}{known}")
    if source == NO_VALUE:
        raise MisuseError(f"--{name} needs a value")
    check: Callable[[str], Iterable[tuple[str, bool, str]]] = checks[name].load()
    return (Finding(*finding, needed=True) for finding in check(source))


def _findings() -> Iterator[Finding]:
    version = ".".join(map(str, sys.version_info[:3]))
    yield Finding("Python", sys.version_info >= LEAST, f"{version}, {platform.platform()}", True)
    yield _tried("the bus", _exchange)
    yield _tried("running worlds", _registry)
    yield Finding("cores", True, f"{os.cpu_count()}; worlds may have more processes")
    yield _memory()
    yield _screen()
    for name, (modules, purpose) in EXTRAS.items():
        # An import would run the code of every package that an extra needs.
        missing = [name for name in modules if find_spec(name) is None]
        hint = f"; {install(name)}" if missing else ""
        yield Finding(name, not missing, purpose + hint)


def _by_group(findings: Iterable[Finding]) -> Iterator[Finding]:
    """One line for each group of extras: those it has, or those it lacks and the remedy."""
    present = {finding.what: finding.good for finding in findings}
    grouped = {name for names in GROUPS.values() for name in names}
    others = tuple([name for name in EXTRAS if name not in grouped])
    for group, names in [*GROUPS.items(), (MORE, others)]:
        missing = ",".join(name for name in names if not present[name])
        remedy = install("NAME" if group == MORE else group)
        note = f"without {missing.replace(',', ', ')}; {remedy}" if missing else ", ".join(names)
        yield Finding(group, not missing, note)


def _tried(what: str, deed: Callable[[], str]) -> Finding:
    try:
        return Finding(what, True, deed(), True)
    except (MinervaError, OSError) as error:
        return Finding(what, False, str(error), True)


def _exchange() -> str:
    """Open a session that listens and one that connects, as a world does."""
    from minerva_bus.runtime.session import open_client, open_hub

    hub, endpoint = open_hub("doctor")
    with hub, open_client("patient", endpoint):
        return f"a session listens on {endpoint.split('/')[0]}, and another connects to it"


def _registry() -> str:
    from minerva_bus.launch.registry import running, runtime_folder

    worlds = ", ".join(each.world for each in running()) or "none"
    return f"{worlds}; noted in {runtime_folder()}"


def _memory() -> Finding:
    from minerva_bus.launch.machine_resources import SHARED_MEMORY

    try:
        free = shutil.disk_usage(SHARED_MEMORY).free >> 20
    except OSError:
        return Finding("shared memory", False, "none; large messages go through sockets")
    return Finding(
        "shared memory", free >= 256, f"{free} MB free in {SHARED_MEMORY}; 64 for each process"
    )


def _screen() -> Finding:
    shown = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY") or ""
    there = bool(shown) or sys.platform == "darwin"
    return Finding("a screen", there, shown or "none; no windows, but pictures, films and pages")
