"""Mutation testing of the core: do the tests detect small faults?

    python -m tools.mutation minerva_bus/world/order.py ... [--minutes 10] [--processes 1]
    python -m tools.mutation            # every module of tools/mutation.toml

mutmut creates the mutants and runs the tests that tools/mutation.toml names for a module, if
they reach the mutated function. Verdicts are stored in build/mutation: an interrupted run continues
where it stopped, and only changed functions and survivors run again after a change. A mutant that
no test kills must be in tools/survivors.toml with the reason for accepting it; otherwise the
command exits with 1, and with 2 if the run is incomplete. `--record` writes the run's counts there,
and each new survivor with an empty reason, to be filled in.

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
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MODULES = ROOT / "tools" / "mutation.toml"
SURVIVORS = ROOT / "tools" / "survivors.toml"
WORKSPACES = ROOT / "build" / "mutation"
LINKED = (
    "agents",
    "benchmarks",
    "deploy",
    "docs",
    "examples",
    "minerva_bus",
    "services",
    "tests",
    "worlds",
)
ALIVE = ("survived", "no tests")
HEAD = """\
# Mutants of the core that no test kills, and why that is accepted; written by
# `python -m tools.mutation --record`, with reasons written by hand. See docs/testing.md.
# [run] has the counts of the last finished run of each module. Modules that are not listed
# have not been run.
"""


@dataclass(frozen=True)
class Survivor:
    """A mutant that no test kills: its change, and the reason for accepting it."""

    module: str
    function: str
    mutation: str
    reason: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """Identity across runs, independent of its number."""
        return self.module, self.function, self.mutation


@dataclass(frozen=True)
class Result:
    """The verdicts on a module's mutants."""

    module: str
    verdicts: dict[str, str]
    survivors: tuple[Survivor, ...]
    same: int = 0
    """Number of mutants that only change the type of a cast, which has no effect at run time."""

    @property
    def waiting(self) -> int:
        """Number of mutants without a verdict."""
        return sum(verdict == "not checked" for verdict in self.verdicts.values())

    @property
    def counts(self) -> dict[str, int]:
        """Counts for [run]."""
        total, alive = len(self.verdicts) - self.same, len(self.survivors)
        return {"mutants": total, "killed": total - alive - self.waiting, "survived": alive}


# --- the list of survivors ------------------------------------------------------------------------


def read_survivors(path: Path = SURVIVORS) -> tuple[dict[str, dict[str, int]], list[Survivor]]:
    """The recorded counts by module, and the accepted survivors."""
    if not path.exists():
        return {}, []
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    return data.get("run", {}), [Survivor(**entry) for entry in data.get("survivor", [])]


def write_survivors(
    runs: dict[str, dict[str, int]], survivors: list[Survivor], path: Path = SURVIVORS
) -> None:
    """Write the list: runs by module, survivors by module, function and mutation."""
    lines = [HEAD, "[run]"]
    for module in sorted(runs):
        counts = ", ".join(f"{name} = {count}" for name, count in runs[module].items())
        lines.append(f"{json.dumps(module)} = {{ {counts} }}")
    for survivor in sorted(survivors, key=lambda entry: entry.key):
        lines += ["", "[[survivor]]"]
        lines += [f"{name} = {_quoted(text)}" for name, text in vars(survivor).items()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def compared(result: Result, accepted: list[Survivor]) -> tuple[list[Survivor], list[Survivor]]:
    """Survivors without a reason, and accepted ones that no longer survive."""
    reasons = {entry.key: entry.reason for entry in accepted if entry.module == result.module}
    new = [entry for entry in result.survivors if not reasons.get(entry.key)]
    keys = {entry.key for entry in result.survivors}
    gone = [entry for entry in accepted if entry.module == result.module and entry.key not in keys]
    return new, gone if not result.waiting else []


def recorded(result: Result, path: Path = SURVIVORS) -> None:
    """Update the list with a finished run: reasons stay, obsolete entries go."""
    runs, accepted = read_survivors(path)
    reasons = {entry.key: entry.reason for entry in accepted}
    others = [entry for entry in accepted if entry.module != result.module]
    entries = {entry.key: entry for entry in result.survivors}
    own = [replace(entry, reason=reasons.get(entry.key, "")) for entry in entries.values()]
    write_survivors({**runs, result.module: result.counts}, others + own, path)


def only_a_cast(mutation: str) -> bool:
    """Whether a mutation only changes the type argument of `cast`."""
    plain = re.sub(r'cast\((?:"[^"]*"|None),', "cast(_,", mutation)
    removed = [line[2:] for line in plain.splitlines() if line.startswith("-")]
    return removed == [line[2:] for line in plain.splitlines() if line.startswith("+")]


def _quoted(text: str) -> str:
    return f"'''\n{text}'''" if "\n" in text else json.dumps(text, ensure_ascii=False)


# --- mutmut ---------------------------------------------------------------------------------------


def run_module(module: str, tests: list[str], processes: int, until: float) -> Result:
    """Run a module's mutants until a monotonic time, and read the verdicts."""
    workspace = _workspace(module, tests)
    _notice_changed_tests(workspace, tests)
    words = [_mutmut(), "run", "--max-children", str(processes)]
    process = subprocess.Popen(words, cwd=workspace, start_new_session=True)
    try:
        process.wait(max(1.0, until - time.monotonic()))
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        os.killpg(process.pid, signal.SIGINT)
        process.wait()
    verdicts = dict(_verdicts(workspace))
    if process.returncode and not any(verdict == "killed" for verdict in verdicts.values()):
        raise SystemExit(f"{module}: mutmut failed; its workspace is {workspace}")
    alive = [name for name, verdict in sorted(verdicts.items()) if verdict in ALIVE]
    survivors = [_survivor(module, name, workspace) for name in alive]
    different = [entry for entry in survivors if not only_a_cast(entry.mutation)]
    return Result(module, verdicts, tuple(different), len(survivors) - len(different))


def _workspace(module: str, tests: list[str]) -> Path:
    """Create a folder with the project and a configuration of mutmut for one module."""
    folder = WORKSPACES / module.removesuffix(".py").replace("/", ".")
    folder.mkdir(parents=True, exist_ok=True)
    pages = [path.name for path in ROOT.glob("*.md")]
    for name in (*LINKED, *pages):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    own = {
        "source_paths": ["minerva_bus"],
        "only_mutate": [module],
        "also_copy": [name for name in (*LINKED, *pages) if name != "minerva_bus"],
        "pytest_add_cli_args_test_selection": tests,
        "pytest_add_cli_args": ["-p", "no:cacheprovider", "--hypothesis-profile=mutation"],
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
    judged = counts["mutants"] - result.waiting
    print(f"{result.module}: {counts['killed']} of {judged} mutants killed")
    for entry in new:
        print(f"  survives without a reason: {entry.function}\n    " + _indented(entry))
    for entry in gone:
        print(f"  listed, but it survives no more: {entry.function}\n    " + _indented(entry))
    if result.waiting:
        print(f"  {result.waiting} mutants wait; run the command again to go on")
    return 1 if new or gone else 2 if result.waiting else 0


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
    parser.add_argument("--record", action="store_true", help="write tools/survivors.toml")
    options = parser.parse_args()
    known = tomllib.loads(MODULES.read_text(encoding="utf-8"))
    unknown = [module for module in options.modules if module not in known]
    if unknown:
        parser.error(f"{unknown[0]} has no tests in {MODULES.relative_to(ROOT)}: add it there")
    until = time.monotonic() + 60 * options.minutes
    codes: set[int] = set()
    for module in options.modules or known:
        result = run_module(module, known[module]["tests"], options.processes, until)
        if options.record and not result.waiting:
            recorded(result)
        codes.add(report(result))
    raise SystemExit(1 if 1 in codes else 2 if 2 in codes else 0)


if __name__ == "__main__":
    main()
