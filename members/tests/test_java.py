"""The members in Java: built with all warnings, the vectors, and the conformance suite."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import gardens
import pytest
from member_vectors import check_garbage, check_vectors
from role_cases import role_cases

from minerva_conformance import report
from minerva_conformance.case import Tier
from minerva_conformance.suite import run_suite
from minerva_conformance.world import MemberRole

PACKAGE = gardens.ROOT / "members" / "java"
PAGE = gardens.ROOT / "docs" / "howto" / "java.md"
OLDEST = 17
QUICK = ("-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1", "-Xshare:auto")
"""Options with which a virtual machine starts quickly: the suite starts one for each case."""
ROLES = (MemberRole.GENERATOR, MemberRole.OBSERVER, MemberRole.COUPLED)


def missing() -> str:
    """What is not installed; empty if everything is."""
    for program in ("make", "java", "javac"):
        if shutil.which(program) is None:
            return program
    text = subprocess.run(["javac", "--version"], capture_output=True, text=True).stdout
    version = re.search(r"\d+", text)
    return "" if version and int(version[0]) >= OLDEST else f"javac {OLDEST} or newer"


pytestmark = pytest.mark.skipif(bool(missing()), reason=f"needs {missing()}")


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The classes."""
    folder = tmp_path_factory.mktemp("java")
    words = ["make", "-C", str(PACKAGE), f"BUILD={folder}"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stderr == "", "a warning"
    return folder


def java(build: Path, name: str) -> list[str]:
    return ["java", *QUICK, "-cp", str(build), name]


def test_it_reads_the_vectors(build: Path) -> None:
    check_vectors(java(build, "minervabus.Vectors"))


def test_garbage_does_not_crash_it(build: Path) -> None:
    check_garbage(java(build, "minervabus.Vectors"))


@pytest.mark.parametrize(("role", "cases"), role_cases(ROLES, part=8))
def test_it_passes_the_conformance_suite(role: MemberRole, cases: list[str], build: Path) -> None:
    card = run_suite(java(build, "Conformance"), cases=cases, roles=[role.value])
    assert "\n".join(report.problems(card)) == ""
    assert report.blocked(card) == 0
    assert card.reached is Tier.ROBUST


def test_the_garden_has_the_digest_of_the_readme(build: Path, tmp_path: Path) -> None:
    """Rain, sun and the picture are in Java."""
    names = {"rain": "Rain", "sun": "Sun", "picture": "Picture"}
    programs = [gardens.command(name, *java(build, names[name])) for name in names]
    summary = gardens.run(tmp_path, gardens.PYTHON_SNAILS + "".join(programs))
    assert summary["digest"] == gardens.readme_digest()
    assert (summary["showers"], summary["shells"]) == (30, 4)
    assert "4 snails" in (tmp_path / "garden.svg").read_text(encoding="utf-8")


def test_the_generator_of_the_guide_runs(build: Path, tmp_path: Path) -> None:
    """The guide's program is run from its source file."""
    (program,) = re.findall(r"```java\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (tmp_path / "Dew.java").write_text(program, encoding="utf-8")
    processes = gardens.PYTHON_SNAILS + gardens.PYTHON_SUN + gardens.PYTHON_RAIN
    dew = gardens.command("dew", "java", "-cp", build, "Dew.java")
    assert gardens.run(tmp_path, processes + dew)["drops"] > 0


def test_without_a_world_it_says_what_is_missing(build: Path) -> None:
    words = java(build, "Rain")
    done = subprocess.run(
        words, env={}, capture_output=True, text=True, executable=shutil.which("java")
    )
    assert (done.returncode, done.stderr.splitlines()) == (
        1,
        ["MINERVA_WORLD is not set; start this program by a world file, or set it"],
    )
    names = {"MINERVA_WORLD": "w", "MINERVA_NAME": "rain"}
    for endpoint, problem in (
        ("tcp/127.0.0.1:9", "Connection refused"),
        ("ws/127.0.0.1:9", "expected tcp/HOST:PORT"),
    ):
        environment = {**names, "MINERVA_CONNECT": endpoint}
        done = subprocess.run(
            words, env=environment, capture_output=True, text=True, executable=shutil.which("java")
        )
        assert done.returncode == 1
        assert done.stderr == f"rain: {problem}: no world at {endpoint}\n"


def test_a_norm_for_people_holds_for_an_attached_program(build: Path, tmp_path: Path) -> None:
    gardens.norm_refuses(tmp_path, java(build, "Sun"))
