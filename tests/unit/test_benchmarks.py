"""Benchmarks: usage after wrong arguments, and exit codes of chaos.py."""

import runpy
import subprocess
import sys
from collections import Counter
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from checks import chaos
from checks.chaos_faults import LONG_WAIT, Chaos


@pytest.mark.parametrize("words", [[], ["mesa"], ["minerva", "schelling", "crowd"]])
def test_wrong_arguments_end_with_the_usage(words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["worker", *words])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("benchmarks.comparison.worker", run_name="__main__")
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage: ")


class Disturbed:
    """A world without processes: `ended` is the launcher's exit code, None while it runs."""

    def __init__(self, digest: str, ended: int | None) -> None:
        self.done = Counter(kill=1)
        self.repeater = SimpleNamespace(sent=3)
        self.launcher = SimpleNamespace(poll=lambda: ended)
        self.closed = False
        self.unsaid = []
        self._digest = digest

    def start(self) -> None: ...
    def disturb(self) -> None: ...

    def end(self) -> dict[str, object]:
        if self._digest == "none":
            raise SystemExit("chaos: frames advance without faults: not within 60 s")
        return {"frames": 9, "digest": self._digest}

    def print_last_lines(self) -> None: ...

    def close(self) -> None:
        self.closed = True


def exit_code(monkeypatch: pytest.MonkeyPatch, world: Disturbed, differ: str = "") -> object:
    """The code with which the command ends."""
    minutes = "1" if world.launcher.poll() is not None else "0"
    monkeypatch.setattr("sys.argv", ["chaos", "--minutes", minutes])
    monkeypatch.setattr(chaos, "Chaos", lambda *_: world)
    monkeypatch.setattr(chaos, "undisturbed", lambda *_: {"frames": 9, "digest": "d1"})
    monkeypatch.setattr(chaos, "same_events", lambda _: differ)
    with pytest.raises(SystemExit) as end:
        chaos.main()
    assert world.closed
    return end.value.code


@pytest.mark.parametrize(
    ("digest", "differ", "ended", "code"),
    [
        ("d1", "", None, 0),
        ("d2", "", None, 1),
        ("d1", "frame 3 differs", None, 1),
        ("d1", "", 0, 1),  # the world has ended before it was stopped
        ("d1", "", 1, 1),
    ],
)
def test_the_exit_code_is_0_only_for_an_equal_run(monkeypatch, digest, differ, ended, code):
    assert exit_code(monkeypatch, Disturbed(digest, ended), differ) == code


def test_a_wait_that_is_not_explained_is_a_failure(monkeypatch, capsys):
    world = Disturbed("d1", None)
    world.unsaid.append("frame 3, 4.0 s: ('ants-1',)")
    assert exit_code(monkeypatch, world) == 1
    assert "without saying for whom, or what follows: frame 3" in capsys.readouterr().out


@pytest.mark.parametrize(("waiting", "outlook", "unsaid"), [
    (("a",), "it will be restarted in 9 s", False),
    (("a",), "", True),
    ((), "", True),
    (("b",), "it will be restarted in 9 s", True),
])  # fmt: skip
def test_a_long_wait_names_a_member_and_what_follows(waiting, outlook, unsaid):
    world = Chaos.__new__(Chaos)
    world.unsaid = []
    members = [SimpleNamespace(name="a", outlook=outlook)]
    for waited in (LONG_WAIT / 2, 2 * LONG_WAIT):
        status = SimpleNamespace(members=members, waiting=waiting, waited=waited, frame=3)
        operator = SimpleNamespace(status=lambda status=status: status)
        world.client = lambda operator=operator: nullcontext(SimpleNamespace(operator=operator))
        world._check_waiting()
    assert len(world.unsaid) == unsaid


def test_a_world_that_hangs_is_a_message(monkeypatch):
    # Python prints a text and exits with code 1.
    assert "not within 60 s" in str(exit_code(monkeypatch, Disturbed("none", None)))


@pytest.mark.parametrize(
    ("code", "output", "differs"),
    [(0, "equal", ""), (1, "frame 3 differs", "frame 3"), (-9, "", "exit code -9")],
)
def test_records_that_could_not_be_compared_are_not_equal(tmp_path, code, output, differs):
    done = subprocess.CompletedProcess([], code, output, "")
    result = chaos.same_events(SimpleNamespace(folder=tmp_path, command=lambda *_: done))  # type: ignore[arg-type]
    assert differs in result
    assert bool(result) == bool(code)
