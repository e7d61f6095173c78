"""The garden of the README with snails in JavaScript, rain in C, sun in Java and the picture in Python."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import gardens
import pytest

from minerva_bus import World

MISSING = [name for name in ("node", "make", "gcc", "javac") if shutil.which(name) is None]
FRAMES = 60
STEP = 10

pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)}")


@pytest.fixture(scope="module")
def garden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The world file of members/garden, in a copy of the folder in which everything is built."""
    members = tmp_path_factory.mktemp("members") / "members"
    unbuilt = shutil.ignore_patterns("build", "__pycache__")
    shutil.copytree(gardens.ROOT / "members", members, ignore=unbuilt)
    file = members / "garden" / "garden.toml"
    (line,) = [each for each in file.read_text(encoding="utf-8").splitlines() if "make" in each]
    build = line.split(": ", 1)[1].replace("members/", f"{members}/")
    subprocess.run(["sh", "-c", build], check=True, capture_output=True)
    return file


def test_members_in_four_languages_give_the_digest_of_the_readme(garden: Path) -> None:
    done = subprocess.run(
        gardens.words(garden),
        env=gardens.environment(garden.parent),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert f'"digest": "{gardens.readme_digest()}"' in done.stdout
    assert '"showers": 30' in done.stdout
    assert "4 snails" in garden.with_name("garden.svg").read_text(encoding="utf-8")


def test_a_member_of_each_language_is_killed_and_the_digest_is_the_same(
    garden: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(sys, "path", list(sys.path))
    victims = ["snails", "rain", "sun", "picture", "rain"]
    killed: dict[str, set[int]] = {name: set() for name in victims}
    with World.load(str(garden)).start(bus=True) as live:
        while live.frame < FRAMES:
            live.step(STEP)
            pids = {member.name: member.pid for member in live.status.members}
            if victims and live.frame < FRAMES:
                name = victims.pop(0)
                assert pids[name] not in killed[name], f"{name} has not been restarted"
                killed[name].add(pids[name])
                os.kill(pids[name], signal.SIGKILL)
        assert live.digest == gardens.readme_digest()
        joins = {member.name: member.joins for member in live.status.members}
    assert victims == []
    assert {name: joins[name] for name in ("snails", "rain", "sun")} == {
        "snails": 2,
        "rain": 3,
        "sun": 2,
    }
