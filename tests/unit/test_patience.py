"""tests/patience.py: limits grow with a slow or loaded machine, and no test has a limit of its own."""

import ast
import os
from pathlib import Path

import pytest

from tests import patience

ROOT = Path(__file__).parents[2]
NAMED = {"timeout", "open_timeout", "patience", "within"}
WAITS = {"wait", "join", "wait_for", "wait_for_publish", "settimeout", "set_default_timeout"}
CLOCKS = {"monotonic", "perf_counter", "time"}
SHORT = 1.0
"""A smaller number is the pace of a loop, not a limit."""
REASONS = {
    "extensions/assistants/tests/reference_server.py": "the interval of a server that the suite for assistants expects",
    "extensions/messages/tests/spade_rig.py": "an agent that looks again each second",
    "extensions/conformance/tests/naive.py": "a member with the times of PROTOCOL.md",
}
"""Files with times that are no guards of a test."""


def limits(path):
    """The calls and comparisons of a file that contain a limit in bare seconds."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    numbers = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant):
            numbers |= {getattr(target, "id", None): node.value.value for target in node.targets}

    def bare(node):
        value = getattr(node, "value", numbers.get(getattr(node, "id", None)))
        return isinstance(value, (int, float)) and value >= SHORT

    def clock(node):
        names = {
            getattr(call.func, "attr", "") for call in ast.walk(node) if isinstance(call, ast.Call)
        }
        return names & CLOCKS

    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", "")
            given = [word.value for word in node.keywords if word.arg in NAMED]
            given += node.args[-1:] if name in WAITS else []
            if any(map(bare, given)):
                yield ast.unparse(node)
        elif isinstance(node, (ast.BinOp, ast.Compare)) and clock(node.left):
            right = node.right if isinstance(node, ast.BinOp) else node.comparators[0]
            yield from [ast.unparse(node)] if bare(right) else []


def test_no_test_has_a_limit_in_bare_seconds():
    found = {}
    folders = ("tests", "extensions/*/tests", "agents/tests", "members/tests", "deploy/tests")
    for path in (path for folder in folders for path in ROOT.glob(f"{folder}/**/*.py")):
        if texts := list(limits(path)):
            found[str(path.relative_to(ROOT))] = texts
    unknown = {name: texts for name, texts in found.items() if name not in REASONS}
    assert not unknown, "take tests.patience, or no limit: that of the test interrupts a call"
    assert not REASONS.keys() - found.keys()


@pytest.mark.parametrize(("clock", "processor", "load", "factor"), [
    (0.8, 0.8, 0.1, 1.0), (3.0, 1.0, 0.1, 3.0), (1.0, 1.0, 20.0, 10.0), (2.0, 2.0, 20.0, 20.0),
    (0.5, 0.5, 20.0, 5.0),
])  # fmt: skip
def test_limits_follow_the_machine_and_its_present_load(
    monkeypatch, clock, processor, load, factor
):
    values = {"BY_CLOCK": clock, "BY_PROCESSOR": processor, "CORES": 2, "PROCESSES": 1}
    for name, value in values.items():
        monkeypatch.setattr(patience, name, value)
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 0.0, 0.0))
    assert patience.patience(10) == pytest.approx(10 * factor)


def test_what_happens_too_late_is_an_error_that_says_so():
    with pytest.raises(patience.Late, match="the tide: not within 0 s") as caught:
        patience.eventually(lambda: False, lambda: "the tide", seconds=0.01)
    assert patience.is_late(caught.value)
    assert not patience.is_late(AssertionError("the tide"))
