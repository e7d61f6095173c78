"""`minerva conformance` on programs: score card, JSON, JUnit XML and exit codes."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

NAIVE = Path(__file__).with_name("naive.py")
MEMBER = (sys.executable, str(NAIVE))
BROKEN = "import naive; naive.Generator.on_tick = lambda *_: None; naive.sys.exit(naive.NaiveMember(naive.os.environ).run())"


def conformance(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", "conformance", *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(NAIVE.parent)},
    )


def test_the_cases_are_listed() -> None:
    done = conformance("--list", "--role", "generator", "--case", "tick", "--json")
    cases = json.loads(done.stdout)
    assert "tick.first" in [case["id"] for case in cases]
    assert all("generator" in case["roles"] for case in cases)


def test_a_member_that_passes(tmp_path: Path) -> None:
    file = tmp_path / "card.xml"
    done = conformance("--case", "tick", "--junit", str(file), "--", *MEMBER)
    assert done.returncode == 0, done.stderr
    assert "roles: generator" in done.stdout
    assert "reached: robust" in done.stdout
    (suite,) = ElementTree.parse(file).getroot()
    assert suite.get("name") == "generator"
    assert (suite.get("failures"), suite.get("errors")) == ("0", "0")
    assert len(suite) == int(suite.get("tests", "0")) > 5


def test_the_python_member_as_a_program() -> None:
    program = (sys.executable, "-m", "minerva_conformance")
    done = conformance("--role", "coupled", "--case", "coupled", "--", *program)
    assert done.returncode == 0, done.stderr
    alone = subprocess.run(program, capture_output=True, text=True, env={})
    assert alone.returncode == 1
    assert "MINERVA_WORLD is not set" in alone.stderr
    assert "Traceback" not in alone.stderr


def test_a_member_that_fails(tmp_path: Path) -> None:
    file = tmp_path / "card.xml"
    words = ("--role", "generator", "--case", "tick.first", "--case", "join.hello")
    done = conformance(*words, "--json", "--junit", str(file), "--", sys.executable, "-c", BROKEN)
    assert done.returncode == 1
    card = json.loads(done.stdout)
    outcomes = {case["id"]: case for case in card["cases"]}
    assert outcomes["join.hello"]["outcome"] == "passed"
    failed = outcomes["tick.first"]
    assert failed["outcome"] == "failed"
    assert failed["requirements"] == ["P8.3", "P7.3"]
    assert failed["expected"] == ["readings echo 0: [['battery', 'r1', 0.0, 1.0, 0.0]]"]
    assert failed["received"] == []
    assert any("'tick', 0" in line for line in failed["sent"])
    assert card["reached"] == "joins"
    (suite,) = ElementTree.parse(file).getroot()
    assert suite.get("failures") == "1"


def test_programs_that_do_not_join() -> None:
    done = conformance("--role", "host", "--case", "death", "--", "false")
    assert done.returncode == 1
    assert "blocked" in done.stdout
    done = conformance("--", "false")
    assert done.returncode == 2
    assert "ended with exit code 1" in done.stderr
    for words in ((), ("--", "/no/such/program"), ("--role", "wizard", "--", "true")):
        done = conformance(*words)
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) < 5


def test_an_interrupted_suite_ends_its_members(tmp_path: Path) -> None:
    started = tmp_path / "started"
    script = (
        f"import os, time; open({str(started)!r}, 'a').write(f'{{os.getpid()}}\\n'); time.sleep(99)"
    )
    suite = subprocess.Popen(
        [sys.executable, "-m", "minerva_bus.cli.main", "conformance", "--", sys.executable, "-c", script],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while not started.exists() or not started.read_text().endswith("\n"):
        assert suite.poll() is None
        time.sleep(0.01)
    suite.send_signal(signal.SIGTERM)
    assert suite.wait() == 130
    for line in started.read_text().split():
        assert not Path(f"/proc/{line}").exists()
