"""The member in JavaScript: its own tests, the conformance suite, and the garden of the README."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import gardens
import pytest
from role_cases import role_cases

from minerva_conformance import report
from minerva_conformance.case import Tier
from minerva_conformance.suite import run_suite
from minerva_conformance.world import MemberRole

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "members" / "javascript"
EXAMPLES = PACKAGE / "examples"
PAGE = ROOT / "docs" / "howto" / "javascript.md"
OLDEST = 18
ROLES = (
    MemberRole.HOST,
    MemberRole.GENERATOR,
    MemberRole.OBSERVER,
    MemberRole.COUPLED,
)


def major() -> int:
    """The version of node; 0 if there is none."""
    node = shutil.which("node")
    if node is None:
        return 0
    text = subprocess.run([node, "--version"], capture_output=True, text=True).stdout
    return int(text.strip().removeprefix("v").split(".")[0])


pytestmark = pytest.mark.skipif(major() < OLDEST, reason=f"needs node {OLDEST} or newer")


def test_its_own_tests_pass() -> None:
    tests = [str(path) for path in sorted((PACKAGE / "test").glob("*.test.js"))]
    done = subprocess.run(["node", "--test", *tests], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-1000:]
    count = re.search(r"^(?:#|ℹ) pass (\d+)", done.stdout, re.M)
    assert count is not None
    assert int(count[1]) > 200


@pytest.mark.parametrize(("role", "cases"), role_cases(ROLES, part=8))
def test_it_passes_the_conformance_suite(role: MemberRole, cases: list[str]) -> None:
    words = ["node", str(EXAMPLES / "conformance.js")]
    card = run_suite(words, cases=cases, roles=[role.value])
    assert "\n".join(report.problems(card)) == ""
    assert report.blocked(card) == 0
    assert card.reached is Tier.ROBUST


def test_it_needs_no_other_package() -> None:
    package = json.loads((PACKAGE / "package.json").read_text(encoding="utf-8"))
    assert not {"dependencies", "peerDependencies", "optionalDependencies"} & set(package)
    sources = [*PACKAGE.glob("src/*.js"), *EXAMPLES.glob("*.js")]
    imports = {
        name
        for path in sources
        for name in re.findall(r'(?:from|import\() ?"([^"]+)"', path.read_text(encoding="utf-8"))
    }
    assert all(name.startswith(("./", "../src/", "node:")) for name in imports), imports


def run_garden(folder: Path, processes: str, string: str = "") -> subprocess.CompletedProcess[str]:
    """A run of the garden with these processes."""
    shutil.copy(EXAMPLES / "garden.py", folder)
    text = (EXAMPLES / "garden.toml").read_text(encoding="utf-8")
    if string:
        text = re.sub("string = .*", f'string = "{string}"', text)
    file = folder / "garden.toml"
    file.write_text(text[: text.index("[process.")] + processes)
    return subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", "run", str(file), "--json"],
        env={**os.environ, "MINERVA_RUNTIME_DIR": str(folder)},
        capture_output=True,
        text=True,
    )


def garden(folder: Path, processes: str, string: str = "") -> dict:
    """The summary of the garden with these processes, each in a world file of its own."""
    done = run_garden(folder, processes, string)
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr
    return json.loads(done.stdout)


def scripts(*names: str) -> str:
    return "".join(
        f'[process.{name}]\ncommand = ["node", "{EXAMPLES / name}.js"]\non_failure = "stop"\n'
        for name in names
    )


def test_the_garden_has_the_digest_of_the_readme(tmp_path: Path) -> None:
    """Every member is in JavaScript; the README's run is in Python, in one process."""
    summary = garden(tmp_path, scripts("snails", "sun", "rain", "picture"))
    assert summary["digest"] == gardens.readme_digest()
    assert summary["frames"] == 60
    assert f"digest {summary['digest']}  (seed 7)" in PAGE.read_text(encoding="utf-8")
    assert "4 snails" in (tmp_path / "garden.svg").read_text(encoding="utf-8")


def test_the_generator_of_the_guide_runs(tmp_path: Path) -> None:
    (program,) = re.findall(r"```js\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    shutil.copytree(PACKAGE / "src", tmp_path / "src")
    shutil.copy(PACKAGE / "package.json", tmp_path)
    folder = tmp_path / "examples"
    folder.mkdir()
    (folder / "dew.js").write_text(program)
    dew = '[process.dew]\ncommand = ["node", "dew.js"]\non_failure = "stop"\n'
    summary = garden(folder, scripts("snails", "sun", "rain") + dew)
    assert summary["drops"] > 0


def test_a_misspelt_event_ends_the_world_after_one_restart(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE / "src", tmp_path / "src")
    shutil.copy(PACKAGE / "package.json", tmp_path)
    folder = tmp_path / "examples"
    folder.mkdir()
    rain = (EXAMPLES / "rain.js").read_text(encoding="utf-8")
    wrong = 'event(frame < 6n ? "eRain" : "eRian")'
    (folder / "rain.js").write_text(rain.replace('event("eRain")', wrong))
    process = '[process.rain]\ncommand = ["node", "rain.js"]\n'
    done = run_garden(folder, scripts("snails", "sun") + process)
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if line.startswith("rain │")]
    problem = "the world's vocabulary has no eRian"
    assert f"rain │ failed in frame 6: {problem}" in said
    assert sum("; restart " in line for line in said) == 1
    assert "failed again with the same error in the same frame" in said[-1]
    assert len(said) <= 8
    assert "dropped" not in done.stderr


def test_snails_in_both_languages_are_the_same(tmp_path: Path) -> None:
    """Two hosts share a population, one of them in Python; both use columns and patches."""
    python = '[process.more]\nagents = "garden:Snail"\n'
    snails = " · ".join(f"ASnail#s{n}<water={1 + n % 7 / 2}>" for n in range(100))
    alone = garden(tmp_path, scripts("sun", "rain") + python, snails)
    shared = garden(tmp_path, scripts("sun", "rain", "snails", "picture") + python, snails)
    assert shared["digest"] == alone["digest"]
    assert "frame 60: " in (tmp_path / "garden.svg").read_text(encoding="utf-8")


def test_without_a_world_it_says_what_is_missing() -> None:
    environment = {name: value for name, value in os.environ.items() if "MINERVA" not in name}
    script = str(EXAMPLES / "sun.js")
    done = subprocess.run(["node", script], env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    assert "MINERVA_WORLD is not set" in done.stderr
    environment |= {
        "MINERVA_WORLD": "w",
        "MINERVA_NAME": "sun",
        "MINERVA_CONNECT": "tcp/127.0.0.1:9",
    }
    done = subprocess.run(["node", script], env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    assert "no world at tcp/127.0.0.1:9" in done.stderr
    assert len(done.stderr.splitlines()) == 1
