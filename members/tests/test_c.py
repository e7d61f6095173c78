"""The members in C: built with all warnings and sanitizers, the vectors, and the conformance suite."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import gardens
import pytest
from member_vectors import check_garbage, check_vectors

from minerva_conformance import report
from minerva_conformance.case import Tier
from minerva_conformance.suite import run_suite
from minerva_conformance.world import MemberRole

PACKAGE = gardens.ROOT / "members" / "c"
MISSING = [program for program in ("make", "gcc") if shutil.which(program) is None]
PAGE = gardens.ROOT / "docs" / "howto" / "c.md"
ROLES = [role for role in MemberRole if role is not MemberRole.HOST]

pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}")


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs, with sanitizers that end a program at its first error."""
    folder = tmp_path_factory.mktemp("c")
    flags = "-g -O1 -Werror -Wconversion -fsanitize=address,undefined -fno-sanitize-recover=all"
    words = ["make", "-C", str(PACKAGE), "CC=gcc", f"BUILD={folder}", f"CFLAGS={flags}"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stderr == ""
    return folder


def test_it_reads_the_vectors(build: Path) -> None:
    check_vectors([str(build / "vectors")])


def test_garbage_does_not_crash_it(build: Path) -> None:
    check_garbage([str(build / "vectors")])


@pytest.mark.parametrize("role", ROLES)
def test_it_passes_the_conformance_suite(role: MemberRole, build: Path) -> None:
    card = run_suite([str(build / "conformance")], roles=[role.value])
    assert "\n".join(report.problems(card)) == ""
    assert report.blocked(card) == 0
    assert card.reached is Tier.ROBUST


def test_the_garden_has_the_digest_of_the_readme(build: Path, tmp_path: Path) -> None:
    """Rain, sun and the picture are in C."""
    programs = [gardens.command(name, build / name) for name in ("rain", "sun", "picture")]
    summary = gardens.run(tmp_path, gardens.PYTHON_SNAILS + "".join(programs))
    assert summary["digest"] == gardens.readme_digest()
    assert (summary["showers"], summary["shells"]) == (30, 4)
    assert "4 snails" in (tmp_path / "garden.svg").read_text(encoding="utf-8")


def test_the_generator_of_the_guide_runs(build: Path, tmp_path: Path) -> None:
    (program,) = re.findall(r"```c\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (compiler,) = re.findall(r"^gcc (.*) -o dew", PAGE.read_text(encoding="utf-8"), re.M)
    shutil.copytree(PACKAGE / "src", tmp_path / "src")
    examples = tmp_path / "examples"
    examples.mkdir()
    (examples / "dew.c").write_text(program, encoding="utf-8")
    sources = sorted(map(str, (tmp_path / "src").glob("*.c")))
    words = ["gcc", *compiler.split(), "-Wall", "-Werror", "-o", str(tmp_path / "dew")]
    subprocess.run([*words, str(examples / "dew.c"), *sources], check=True)
    processes = gardens.PYTHON_SNAILS + gardens.PYTHON_SUN + gardens.PYTHON_RAIN
    summary = gardens.run(tmp_path, processes + gardens.command("dew", tmp_path / "dew"))
    assert summary["drops"] > 0


def test_without_a_world_it_says_what_is_missing(build: Path) -> None:
    rain = str(build / "rain")
    done = subprocess.run([rain], env={}, capture_output=True, text=True)
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
        done = subprocess.run([rain], env=environment, capture_output=True, text=True)
        assert done.returncode == 1
        assert done.stderr == f"rain: {problem}: no world at {endpoint}\n"


def test_a_norm_for_people_holds_for_an_attached_program(build: Path, tmp_path: Path) -> None:
    gardens.norm_refuses(tmp_path, [str(build / "sun")])
