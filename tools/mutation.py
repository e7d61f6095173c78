"""Mutation testing of the core: do the tests detect small faults?

    python -m tools.mutation minerva_bus/world/event_collection.py ... [--minutes 10] [--sample 1]
    python -m tools.mutation            # every module of tools/mutation.toml

mutmut creates the mutants and runs the tests that tools/mutation.toml names for a module, without
those to `deselect`, if they reach the mutated function. Verdicts are stored in build/mutation: an
interrupted run continues where it stopped, and only changed functions and survivors run again after
a change. A mutant that no test kills must be in tools/survivors.toml with the reason for accepting
it; otherwise the command exits with 1, and with 2 if the run is incomplete. `--record` writes the
run's counts there, and each new survivor with an empty reason, to be filled in. `--sample 1` runs
only the mutants with the numbers 1, 11, 21 ... of each function, where all would take too long.

mutmut changes functions and plain, static and class methods; it skips properties and other
decorated functions. A mutant that only changes the type argument of `cast` is not counted.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

from tools.survivors import (
    ROOT,
    Result,
    Survivor,
    compared,
    only_a_cast,
    read_survivors,
    recorded,
)

MODULES = ROOT / "tools" / "mutation.toml"
WORKSPACES = ROOT / "build" / "mutation"
LINKED = (
    "agents",
    "benchmarks",
    "checks",
    "conftest.py",
    "deploy",
    "docs",
    "examples",
    "extensions",
    "minerva_bus",
    "services",
    "tests",
    "worlds",
)
ALIVE = ("survived", "no tests")
INCOMPLETE = 2
"""Exit code: mutants without a verdict remain."""


# --- mutmut ---------------------------------------------------------------------------------------


def run_module(
    module: str,
    tests: list[str],
    processes: int,
    until: float,
    digits: str = "",
    deselect: Sequence[str] = (),
) -> Result:
    """Run a module's mutants until a monotonic time, and read the verdicts.

    With `digits`, only the mutants whose number in their function ends with one of them. The tests
    to `deselect` are left out, for example because they take long and others detect the same.
    """
    workspace = _workspace(module, tests, deselect)
    _notice_changed_tests(workspace, tests)
    words = [_mutmut(), "run", "--max-children", str(processes), *_sample(workspace, digits)]
    code = _run(words, workspace, until)
    every = dict(_verdicts(workspace)) if (workspace / "mutants").exists() else {}
    verdicts = {name: verdict for name, verdict in every.items() if _is_in_sample(name, digits)}
    if code is None and not verdicts:
        _print_incomplete(module, "the time was over before the mutants were there")
        raise SystemExit(INCOMPLETE)
    if code and not every:
        raise SystemExit(
            f"{module}: no mutants: mutmut changes no decorated functions, and there are no others"
        )
    if code and not any(verdict == "killed" for verdict in verdicts.values()):
        raise SystemExit(f"{module}: mutmut failed; its workspace is {workspace}")
    alive = [name for name, verdict in sorted(verdicts.items()) if verdict in ALIVE]
    survivors = [_survivor(module, name, workspace) for name in alive]
    different = [entry for entry in survivors if not only_a_cast(entry.mutation)]
    same = len(survivors) - len(different)
    return Result(module, verdicts, tuple(different), same, len(every) if digits else None)


def _run(words: list[str], workspace: Path, until: float) -> int | None:
    """Run mutmut until a monotonic time; its exit code, or None if the time was over."""
    process = subprocess.Popen(words, cwd=workspace, start_new_session=True)
    try:
        return process.wait(max(1.0, until - time.monotonic()))
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        # Its own exit code then says nothing: interrupted statistics count as an error.
        os.killpg(process.pid, signal.SIGINT)
        process.wait()
        return None


def _sample(workspace: Path, digits: str) -> list[str]:
    """Names of a sample for mutmut, which runs mutants that are named again.

    So these are the mutants without a verdict, after an interruption, or patterns for all.
    """
    known = _verdicts(workspace) if digits and (workspace / "mutants").exists() else ()
    waiting = [name for name, verdict in known if verdict == "not checked"]
    patterns = [f"*__mutmut_*{digit}" for digit in digits]
    return [name for name in waiting if _is_in_sample(name, digits)] or patterns


def _is_in_sample(name: str, digits: str) -> bool:
    return not digits or name[-1] in digits


def _workspace(module: str, tests: list[str], deselect: Sequence[str]) -> Path:
    """Create a folder with the project and a configuration of mutmut for one module."""
    folder = WORKSPACES / module.removesuffix(".py").replace("/", ".")
    folder.mkdir(parents=True, exist_ok=True)
    pages = [path.name for path in ROOT.glob("*.md")]
    left_out = [word for test in deselect for word in ("--deselect", test)]
    for name in (*LINKED, *pages):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    own = {
        "source_paths": ["minerva_bus"],
        "only_mutate": [module],
        "also_copy": [name for name in (*LINKED, *pages) if name != "minerva_bus"],
        "pytest_add_cli_args_test_selection": tests,
        "pytest_add_cli_args": [
            *("-p", "no:cacheprovider", "--hypothesis-profile=mutation"),
            *left_out,
        ],
        "use_git_change_detection": False,
        "on_dependency_change": "ignore",
    }
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8") + "\n[tool.mutmut]\n"
    text += "".join(f"{name} = {json.dumps(value)}\n" for name, value in own.items())
    (folder / "pyproject.toml").write_text(text, encoding="utf-8")
    return folder


def _notice_changed_tests(workspace: Path, tests: list[str]) -> None:
    """Rerun survivors if tests have changed; mutmut only detects changed functions."""
    known, stats = workspace / "tests.sha256", workspace / "mutants" / "mutmut-stats.json"
    files = sorted(path for test in tests for path in _files(ROOT / test))
    now = hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
    if known.exists() and known.read_text() != now:
        stats.unlink(missing_ok=True)
        _forget_survivors(workspace)
    known.write_text(now)


def _forget_survivors(workspace: Path) -> None:
    """Make mutmut rerun survivors."""
    for path in (workspace / "mutants" / "minerva_bus").rglob("*.meta"):
        data = json.loads(path.read_text(encoding="utf-8"))
        codes = data["exit_code_by_key"]
        data["exit_code_by_key"] = {k: code if code == 1 else None for k, code in codes.items()}
        path.write_text(json.dumps(data), encoding="utf-8")


def _files(path: Path) -> Iterator[Path]:
    yield from path.rglob("*.py") if path.is_dir() else (path,)


def _verdicts(workspace: Path) -> Iterator[tuple[str, str]]:
    for line in _said("results", "--all", "true", workspace=workspace).splitlines():
        name, _, verdict = line.strip().partition(": ")
        if verdict:
            yield name, verdict


def _survivor(module: str, name: str, workspace: Path) -> Survivor:
    """The change of a mutant: removed and added lines."""
    lines = _said("show", name, workspace=workspace).splitlines()
    changed = [line for line in lines if re.match(r"[-+](?![-+]{2} )", line)]
    mutation = "\n".join(f"{line[0]} {line[1:].strip()}" for line in changed)
    return Survivor(module, _function(name), mutation)


def _function(name: str) -> str:
    """The function of a mutant: for example `A.f` for `module.xǁAǁf__mutmut_3`."""
    return name.rpartition(".")[2].rpartition("__mutmut_")[0][2:].replace("ǁ", ".")


def _said(*words: str, workspace: Path) -> str:
    done = subprocess.run([_mutmut(), *words], cwd=workspace, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"mutmut {words[0]} failed in {workspace}:\n{done.stderr[-2000:]}")
    return done.stdout


def _mutmut() -> str:
    program = Path(sys.executable).with_name("mutmut")
    if not program.exists():
        raise SystemExit("mutation testing takes mutmut: pip install -e '.[dev,mutation]'")
    return str(program)


# --- the command ----------------------------------------------------------------------------------


def report(result: Result) -> int:
    """Print the results of a run and return its exit code."""
    new, gone = compared(result, read_survivors()[1])
    counts = result.counts
    judged = counts["killed"] + counts["survived"]
    print(f"{result.module}: {counts['killed']} of {judged} mutants killed")
    for entry in new:
        print(f"  survives without a reason: {entry.function}\n    " + _indented(entry))
    for entry in gone:
        print(f"  listed, but it survives no more: {entry.function}\n    " + _indented(entry))
    if result.waiting:
        print(f"  {result.waiting} mutants wait; run the command again to go on")
    if result.waiting == len(result.verdicts) > 0:
        _print_incomplete(result.module, "all tests run once before the first mutant")
    return 1 if new or gone else INCOMPLETE if result.waiting else 0


def _print_incomplete(module: str, why: str) -> None:
    print(f"{module}: incomplete: {why}; allow more --minutes")


def _indented(entry: Survivor) -> str:
    return entry.mutation.replace("\n", "\n    ")


def main() -> None:
    """Run the command."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # started in the background of a shell
        signal.signal(signal.SIGINT, signal.default_int_handler)
    parser = argparse.ArgumentParser(description="mutation testing of modules of the core")
    parser.add_argument("modules", nargs="*", help="files of tools/mutation.toml; none: all")
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after so long")
    parser.add_argument("--processes", type=int, default=1, help="mutants at a time")
    parser.add_argument("--sample", default="", help="only mutants whose numbers end with: 1, 16")
    parser.add_argument("--record", action="store_true", help="write tools/survivors.toml")
    options = parser.parse_args()
    known = tomllib.loads(MODULES.read_text(encoding="utf-8"))
    unknown = [module for module in options.modules if module not in known]
    if unknown:
        parser.error(f"{unknown[0]} has no tests in {MODULES.relative_to(ROOT)}: add it there")
    until = time.monotonic() + 60 * options.minutes
    codes: set[int] = set()
    for module in options.modules or known:
        entry = known[module]
        result = run_module(
            module,
            entry["tests"],
            options.processes,
            until,
            options.sample,
            entry.get("deselect", ()),
        )
        if options.record and not result.waiting:
            recorded(result)
        codes.add(report(result))
    raise SystemExit(1 if 1 in codes else INCOMPLETE if INCOMPLETE in codes else 0)


if __name__ == "__main__":
    main()
