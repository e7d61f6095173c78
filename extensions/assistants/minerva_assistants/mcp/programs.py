"""Tools that run commands of Minerva Bus in a process of their own: run, sweep, plot and diff.

Files are named relative to the server's folder, and none outside it is read or written.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, cast

from minerva_analysis.tables import read_table
from minerva_assistants.mcp.tool import Result, Tool, ToolCall, ToolImage, text, whole
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.installed import declared_options, installed_worlds
from minerva_bus.launch.registry import temporary_folder

MAX_SECONDS: Final = 600
END_SECONDS: Final = 1.0
POLL_SECONDS: Final = 0.1
MAX_ROWS: Final = 500
FAILED: Final = 1
"""Exit code of a command that has an answer about a failure or a difference."""


def file_inside(folder: Path, name: str, *suffixes: str) -> Path:
    """The path of a file in the folder. Raises MisuseError if it is elsewhere."""
    problem = f"{name!r}: expected a file in the server's folder, as a relative path"
    try:
        path = (folder / name).resolve()
        inside = path.is_relative_to(folder.resolve()) and not Path(name).is_absolute()
    except (OSError, ValueError, RuntimeError):
        raise MisuseError(problem) from None
    if not inside or path == folder.resolve():
        raise MisuseError(problem)
    if suffixes and path.suffix not in suffixes:
        raise MisuseError(f"{name!r}: expected a file {', '.join(suffixes)}")
    return path


def input_file(call: ToolCall, argument: str, *suffixes: str) -> str:
    """The path of an existing file that an argument names. Raises MisuseError."""
    path = file_inside(call.folder, call.arguments[argument], *suffixes)
    if not path.is_file():
        raise MisuseError(f"there is no file {call.arguments[argument]!r} in the server's folder")
    return str(path)


def _world(call: ToolCall) -> str:
    name, installed = call.arguments["world"], installed_worlds()
    if name in installed:
        return name
    if name.endswith(".toml"):
        return input_file(call, "world", ".toml")
    hint = nearest(name, [*installed]) or f"; there are {', '.join(installed)}"
    raise MisuseError(f"there is no installed world {name!r}, and no world file{hint}")


def _value(call: ToolCall, name: str, value: Any) -> str:
    if not isinstance(value, str):
        return json.dumps(value)
    # An option may name a file, such as a map.
    file_inside(call.folder, f"./{value}" if value[:1] not in ("/", "~") else value)
    if value.startswith("~"):
        raise MisuseError(f"{name}: {value!r} names a file outside the server's folder")
    return value


def _check_options(world: str, names: Sequence[str], *more: str) -> None:
    known = [*(option.name for option in declared_options(world)), *more]
    for name in names:
        if name not in known:
            hint = nearest(name, known) or f"; it has {', '.join(known) or 'none'}"
            raise MisuseError(f"the world has no option {name!r}{hint}")


def run_command(call: ToolCall, *words: str) -> dict[str, Any]:
    """The JSON object that a command prints. Raises MisuseError if it fails or takes too long."""
    seconds = call.arguments.get("seconds", 60)
    process = subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "minerva_bus", *words, "--json"],
        cwd=call.folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    until = time.monotonic() + seconds
    try:
        while True:
            try:
                out, problems = process.communicate(timeout=POLL_SECONDS)
                break
            except subprocess.TimeoutExpired:
                if call.stop.is_set():
                    raise MisuseError(f"{words[0]} was cancelled") from None
                if time.monotonic() >= until:
                    raise MisuseError(
                        f"{words[0]} was ended: it took longer than {seconds} s; give fewer frames"
                        " or more `seconds`"
                    ) from None
    finally:
        _end(process)
    return _answer(process.returncode, out, problems)


def _end(process: subprocess.Popen[str]) -> None:
    """End a command with all of its processes."""
    for number in (signal.SIGINT, signal.SIGKILL):
        if process.poll() is not None:
            return
        try:
            # It leads a group of its own, and its children end with it.
            os.killpg(process.pid, number)
            process.communicate(timeout=END_SECONDS)
        except (ProcessLookupError, subprocess.TimeoutExpired):
            continue


def _answer(code: int, out: str, problems: str) -> dict[str, Any]:
    try:
        answer: Any = json.loads(out)
    except ValueError:
        answer = {}
    if not isinstance(answer, dict):
        answer = {"result": answer}
    shown = cast("dict[str, Any]", answer)
    if code not in (0, FAILED) or not shown or "error" in shown:
        reason = str(shown.get("error") or problems.strip() or f"it ended with code {code}")
        raise MisuseError(reason[-2000:])
    return shown


def _run(call: ToolCall) -> Result:
    arguments, world = call.arguments, _world(call)
    options = arguments.get("options", {})
    _check_options(world, [*options])
    words = ["run", world, "--in-process", "--quiet", "--rate=0", f"--frames={arguments['frames']}"]
    words += [f"--{name.replace('_', '-')}={_value(call, name, options[name])}" for name in options]
    if "seed" in arguments:
        words.append(f"--seed={arguments['seed']}")
    if "record" in arguments:
        words.append(f"--record={file_inside(call.folder, arguments['record'], '.mcap')}")
    files = {name: arguments[name] for name in ("record",) if name in arguments}
    if "collect" not in arguments:
        return {**run_command(call, *words), **files}
    name = arguments.get("into", "collected.csv")
    into = file_inside(call.folder, name, ".csv", ".parquet")
    answer = run_command(call, *words, *_collected(call), f"--into={into}")
    table = read_table(into)
    last = {column: table[column].tolist()[-1] for column in table.columns if len(table)}
    return {**answer, **files, "table": name, "last_row": last}


def _collected(call: ToolCall) -> list[str]:
    given = call.arguments.get("collect", {})
    return [f"--collect={name}={expression}" for name, expression in given.items()]


def _sweep(call: ToolCall) -> Result:
    arguments, world = call.arguments, _world(call)
    values = arguments["values"]
    _check_options(world, [*values], "seed")
    words = ["sweep", world, "--in-process", "--quiet", f"--frames={arguments['frames']}"]
    for name, listed in values.items():
        texts = [_value(call, name, value) for value in listed]
        if any(set(shown) & set(",:") for shown in texts):
            raise MisuseError(f"{name}: a value must not contain , or :")
        words.append(f"--set={name}={','.join(texts)}")
    with temporary_folder("mcp") as folder:
        table = folder / "sweep.csv"
        answer = run_command(call, *words, f"--output={table}")
        rows = table.read_text(encoding="utf-8").splitlines()
    more = max(0, len(rows) - 1 - MAX_ROWS)
    kept = {name: answer[name] for name in ("world", "runs", "failed") if name in answer}
    return {**kept, "csv": "\n".join(rows[: MAX_ROWS + 1]), "rows_left_out": more}


def _diff(call: ToolCall) -> Result:
    return run_command(call, "diff", input_file(call, "a", ".mcap"), input_file(call, "b", ".mcap"))


def _plot(call: ToolCall) -> Result:
    arguments = call.arguments
    words = ["plot", input_file(call, "file", ".mcap", ".csv", ".parquet")]
    words += _collected(call)
    words += [f"--{name}={arguments[name]}" for name in ("series", "x") if name in arguments]
    words += ["--bars"] if arguments.get("bars") else []
    with temporary_folder("mcp") as folder:
        picture = folder / "plot.png"
        run_command(call, *words, f"--output={picture}")
        return ToolImage(picture.read_bytes(), "image/png")


_NAME: Final = "^[A-Za-z_][A-Za-z0-9_.-]*$"
_WORLD: Final = text("Installed world, or a world file (.toml) in the server's folder.")
_FRAMES: Final = whole("Number of frames.", 1, 1_000_000)
SECONDS: Final = whole("Time limit in seconds.", 1, MAX_SECONDS, default=60)
_COLLECT: Final = {
    "type": "object",
    "description": "Expressions by name, such as {'sick': 'count(APerson, days > 0)'}.",
    "propertyNames": {"pattern": _NAME},
    "additionalProperties": text("Expression.", 1000),
    "maxProperties": 50,
}
_SCALAR: Final = {"type": ["number", "boolean", "string"], "maxLength": 1000}

READING: Final = (
    Tool(
        "diff",
        "Compare two records: the first frame in which they differ, and why.",
        _diff,
        {"a": text("Record (.mcap)."), "b": text("Other record (.mcap)."), "seconds": SECONDS},
        ("a", "b"),
        example={"a": "run.mcap", "b": "other.mcap"},
    ),
    Tool(
        "plot",
        "Plot a record, or a table of collected data, as PNG.",
        _plot,
        {
            "file": text("Record (.mcap) or table (.csv, .parquet)."),
            "collect": _COLLECT,
            "series": text("Columns to plot, separated by commas."),
            "x": text("Column along the axis."),
            "bars": {"type": "boolean", "description": "Histograms of the last frame."},
            "seconds": SECONDS,
        },
        ("file",),
        example={"file": "foxes.csv", "series": "foxes"},
    ),
)

RUNNING: Final = (
    Tool(
        "run_world",
        "Run a world for a number of frames; optionally record it and collect data.",
        _run,
        {
            "world": _WORLD,
            "frames": _FRAMES,
            "seed": whole("Seed of all random numbers.", 0, 2**53),
            "options": {
                "type": "object",
                "description": "Values of the world's own options.",
                "propertyNames": {"pattern": _NAME},
                "additionalProperties": _SCALAR,
                "maxProperties": 50,
            },
            "record": text("Record of the run to write (.mcap)."),
            "collect": _COLLECT,
            "into": text("Table for collected data (.csv, .parquet).", default="collected.csv"),
            "seconds": SECONDS,
        },
        ("world", "frames"),
        permission="run",
        example={"world": "meadow", "frames": 100, "collect": {"foxes": "count(AFox)"}},
    ),
    Tool(
        "sweep",
        "Run a world with all combinations of values of its options; returns a table.",
        _sweep,
        {
            "world": _WORLD,
            "frames": _FRAMES,
            "values": {
                "type": "object",
                "description": "Values by option; `seed` is one, too.",
                "propertyNames": {"pattern": _NAME},
                "additionalProperties": {
                    "type": "array",
                    "items": _SCALAR,
                    "minItems": 1,
                    "maxItems": 100,
                },
                "minProperties": 1,
                "maxProperties": 10,
            },
            "seconds": SECONDS,
        },
        ("world", "frames", "values"),
        permission="run",
        example={"world": "meadow", "frames": 100, "values": {"seed": [1, 2, 3]}},
    ),
)
