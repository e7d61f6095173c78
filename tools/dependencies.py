"""Locked dependencies: write locks, report licences and vulnerabilities, test the bounds.

    python -m tools.dependencies                # licences and known vulnerabilities
    python -m tools.dependencies lock           # write requirements/ from pyproject.toml
    python -m tools.dependencies try oldest     # tests with the oldest allowed versions
    python -m tools.dependencies try newest     # tests with the newest allowed versions

It requires the extra `audit`, which pip install -e '.[dev]' includes.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCKS = ROOT / "requirements"
OLDEST_PYTHON = "3.11"
EDITABLE = "editables"
"""Requirement of hatchling for editable installs, besides pyproject's build-system."""

IMAGE_EXTRAS = ("metrics", "record", "tls")
RESOLUTIONS = {"oldest": "lowest-direct", "newest": "highest"}
FAST = (
    *("unit", "laws", "frame", "wire", "log", "paper", "fuzz", "api/test_collected.py", "views"),
    *("physics", "services", "bridges", "cli", "../extensions/study/tests"),
    *("../extensions/cosimulation/tests", "../extensions/learning/tests"),
)
"""Tests that together import every dependency that does not need a device."""


@dataclass(frozen=True)
class Locked:
    """A locked version with its markers, its hashes and the packages that require it."""

    name: str
    version: str
    marker: str
    hashes: tuple[str, ...]
    via: tuple[str, ...]


def read(lock: Path) -> list[Locked]:
    """The versions of a lock file, in order."""
    entries = re.split(r"^(?=[A-Za-z0-9])", lock.read_text(encoding="utf-8"), flags=re.M)[1:]
    return [_locked(entry) for entry in entries]


def _locked(entry: str) -> Locked:
    head = re.match(r"(\S+)==(\S+)(?: ; (.*?))?(?: \\)?$", entry, re.M)
    if head is None:
        raise SystemExit(f"requirements: not a version with `==`: {entry.splitlines()[0]}")
    hashes = re.findall(r"--hash=(sha256:[0-9a-f]{64})\b", entry)
    via = re.search(r"# via\b(.*)", entry, re.S)
    required_by = re.findall(r"[^\s#,][^\n,]*", via[1]) if via else []
    return Locked(head[1], head[2], head[3] or "", tuple(hashes), tuple(required_by))


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def lock() -> int:
    """Write all locks; image and build use the versions of the tests."""
    LOCKS.mkdir(exist_ok=True)
    build = project()["build-system"]["requires"]
    dev = LOCKS / "dev.txt"
    compile_lock(dev, [*build, EDITABLE], "--extra=dev", "--upgrade", "pyproject.toml")
    same = f"--constraint={dev.relative_to(ROOT)}"
    extras = [f"--extra={extra}" for extra in IMAGE_EXTRAS]
    compile_lock(LOCKS / "image.txt", [], *extras, same, "pyproject.toml")
    compile_lock(LOCKS / "build.txt", build, same)
    return 0


def compile_lock(path: Path, requirements: list[str], *arguments: str) -> None:
    """Write one lock for every platform and allowed Python."""
    command = [
        sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal", "--generate-hashes",
        f"--python-version={OLDEST_PYTHON}", "--no-header", *arguments,
        f"--output-file={path.relative_to(ROOT)}",
    ]  # fmt: skip
    if requirements:
        command.append("-")
    subprocess.run(command, cwd=ROOT, input="\n".join(requirements), text=True, check=True)
    path.write_text(
        "# Written by `python -m tools.dependencies lock` from pyproject.toml.\n"
        + path.read_text(encoding="utf-8"),
        encoding="utf-8",
    )


def report() -> int:
    """Print the licences and the known vulnerabilities of all locked versions.

    Returns: 0 if none is known, 1 if one is, 2 if the advisories do not cover every package.
    """
    locked = read(LOCKS / "dev.txt")
    in_image = {entry.name for entry in read(LOCKS / "image.txt")}
    names = {entry.name for entry in locked}
    print(f"{len(names)} dependencies are locked; * marks the {len(in_image)} of the image.\n")
    print_licences(names, in_image)
    return print_vulnerabilities(LOCKS / "dev.txt")


def print_licences(names: set[str], in_image: set[str]) -> None:
    """Print package names by licence, as declared by the installed packages."""
    by_licence: dict[str, list[str]] = defaultdict(list)
    stated = licences()
    for name in sorted(names):
        licence = stated.get(name, "not installed here (another platform or Python)")
        by_licence[licence].append(f"{name}*" if name in in_image else name)
    for licence, members in sorted(by_licence.items()):
        print(f"{licence}:\n    {', '.join(members)}")


def licences() -> dict[str, str]:
    """The declared licence of each installed package, on one line."""
    done = subprocess.run(
        [sys.executable, "-m", "piplicenses", "--format=json", "--from=all", "--with-system"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return {
        re.sub(r"[-_.]+", "-", package["Name"]).lower(): _licence(package)
        for package in json.loads(done.stdout)
    }


def _licence(package: dict[str, str]) -> str:
    """The licence expression, else the classifier, else the first line of the text."""
    for kind in ("License-Expression", "License-Classifier", "License-Metadata"):
        text = package.get(kind, "UNKNOWN").strip()
        if text and text != "UNKNOWN":
            return text.splitlines()[0][:80]
    return "not stated"


def print_vulnerabilities(lock: Path) -> int:
    """Print the advisories for a lock from the first source that responds."""
    silent = []
    for source in ("pypi", "osv"):
        answer, reason = ask(source, lock)
        if answer is not None:
            return print_answer(source, answer)
        silent.append(f"{source}: {reason}")
    print("\nVulnerabilities: UNKNOWN. No source gives advisories for these packages:")
    print("\n".join(f"    {line}" for line in silent))
    print("Run this again where a source can be reached that knows them.")
    return 2


def ask(source: str, lock: Path) -> tuple[list[dict] | None, str]:
    """Advisories of a source for a lock, or None with the reason.

    A source without any of the packages does not count, although pip-audit then reports "no
    vulnerabilities".
    """
    done = subprocess.run(
        [sys.executable, "-m", "pip_audit", "--vulnerability-service", source,
         "--requirement", lock, "--disable-pip", "--require-hashes",
         "--format=json", "--progress-spinner=off"],
        capture_output=True, text=True,
    )  # fmt: skip
    try:
        answer = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        return None, (done.stderr.strip().splitlines() or ["no answer"])[-1][:160]
    if all("skip_reason" in package for package in answer):
        return None, "it knows none of the packages"
    return answer, ""


def print_answer(source: str, answer: list[dict]) -> int:
    skipped = [package["name"] for package in answer if "skip_reason" in package]
    bad = [package for package in answer if package.get("vulns")]
    print(f"\nVulnerabilities known to {source}: {sum(len(each['vulns']) for each in bad)}")
    for package in bad:
        for advisory in package["vulns"]:
            fixed = ", ".join(advisory.get("fix_versions", ())) or "no version"
            print(f"    {package['name']} {package['version']}: {advisory['id']}, fixed in {fixed}")
    if skipped:
        print(f"Not in {source}, so UNKNOWN: {', '.join(skipped)}")
    return 1 if bad else 2 if skipped else 0


def try_versions(which: str, python: str, paths: list[str]) -> int:
    """Run tests with the oldest or newest versions that pyproject.toml allows."""
    folder = ROOT / "build" / "dependencies" / f"{which}-{python}"
    interpreter = folder / "bin" / "python"
    uv = [sys.executable, "-m", "uv"]
    subprocess.run([*uv, "venv", "--quiet", "--clear", "--python", python, folder], check=True)
    subprocess.run(
        [*uv, "pip", "install", "--quiet", "--python", interpreter, "--upgrade",
         "--resolution", RESOLUTIONS[which], "--editable", ".[dev]"], cwd=ROOT, check=True,
    )  # fmt: skip
    tests = paths or [f"tests/{name}" for name in FAST]
    command = [interpreter, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--retry", *tests]
    return subprocess.run(command, cwd=ROOT).returncode


def parse(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tools.dependencies", description=(__doc__ or "").partition("\n")[0]
    )
    commands = parser.add_subparsers(dest="command")
    commands.add_parser("report", help="licences and known vulnerabilities (the default)")
    commands.add_parser("lock", help="write requirements/ from pyproject.toml")
    trying = commands.add_parser("try", help="run tests with the oldest or newest versions")
    trying.add_argument("which", choices=RESOLUTIONS)
    trying.add_argument("paths", nargs="*", help="tests (default: the fast ones)")
    trying.add_argument("--python", default=OLDEST_PYTHON, help="the version of Python")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    given = parse(words)
    needed = {"lock": ("uv",), "try": ("uv",)}.get(given.command, ("piplicenses", "pip_audit"))
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        print(f"{' and '.join(missing)} not installed: pip install -e '.[audit]'", file=sys.stderr)
        return 2
    if given.command == "lock":
        return lock()
    if given.command == "try":
        return try_versions(given.which, given.python, given.paths)
    return report()


if __name__ == "__main__":
    try:
        sys.exit(main())
    except subprocess.CalledProcessError as failure:
        print((failure.stderr or "") + f"{failure.cmd[2]} failed", file=sys.stderr)
        sys.exit(2)
