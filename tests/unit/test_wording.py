"""Words that several layers share."""

import importlib.util
import sys

import pytest

from minerva_bus.launch.summary import RunSummary
from minerva_bus.wording import counted, frames_up_to, install


@pytest.mark.parametrize(
    ("end", "text"),
    [(0, "no frames"), (1, "frame 0 only"), (2, "frames 0 to 1"), (60, "frames 0 to 59")],
)
def test_the_frames_of_a_record(end, text):
    assert frames_up_to(end) == text


@pytest.mark.parametrize(
    ("number", "noun", "text"),
    [(1, "agent", "1 agent"), (1200, "agent", "1,200 agents"), (2, "process", "2 processes")],
)
def test_counts(number, noun, text):
    assert counted(number, noun) == text


def test_a_run_without_a_frame_has_no_time_of_its_first_frame():
    summary = RunSummary("w", 0, "d", False, "interrupted", 0.0, None, 1, 0, {}, {})
    assert summary.plain()["first_frame_seconds"] is None
    assert "  no frame was completed" in summary.lines()


@pytest.mark.parametrize(
    ("pip", "text"),
    [
        (object(), "/env/bin/python -m pip install 'minerva-bus[web]'"),
        (None, "uv pip install --python /env/bin/python 'minerva-bus[web]'"),
    ],
    ids=["pip", "made by uv"],
)
def test_an_extra_is_installed_with_what_the_environment_has(monkeypatch, pip, text):
    monkeypatch.setattr(sys, "executable", "/env/bin/python")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: pip)
    assert install("web") == text
