"""Benchmarks with wrong arguments show their usage, without a traceback."""

import runpy
import sys

import pytest

WRONG = {
    "environments": [["robot"]],
    "peer_statistics": [[], ["mesa", "wealth", "10", "1", "last"], ["mesaframes", "wolf_sheep"]],
    "comparison.worker": [[], ["mesa"], ["minerva", "schelling", "crowd"]],
}


@pytest.mark.parametrize(
    ("name", "words"), [(name, words) for name, given in WRONG.items() for words in given]
)
def test_wrong_arguments_end_with_the_usage(name, words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, *words])
    monkeypatch.setattr(sys, "path", [*sys.path])  # peer_statistics adds the current folder
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage: ")
