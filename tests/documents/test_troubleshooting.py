"""Messages that docs/troubleshooting.md quotes are produced, and no error class is left out."""

import re
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))
from troubles import PRINTED, RAISED

import minerva_bus.errors as errors

PAGE = (Path(__file__).parents[2] / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
ROWS: dict[str, str] = dict(
    re.findall(r"^\| `([^`]+)` \| (?:`(\w+)`)? ?\| .+ \| .+ \|$", PAGE, re.M)
)
"""The error class of each quoted message; empty for a line of the log or of a command."""

CLASSES = re.findall(r"(?:^ {4}|── )([A-Z]\w+)", (errors.__doc__ or "").split("\n\n")[1], re.M)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty current folder, in an environment without worlds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))
    return tmp_path


def chain(error):
    """An error and those that it was raised from."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


@pytest.mark.parametrize("message", RAISED)
def test_a_mistake_raises_the_quoted_error(message, folder):
    with pytest.raises(errors.MinervaError) as caught:
        RAISED[message](folder)
    causes = [error for error in chain(caught.value) if type(error).__name__ == ROWS[message]]
    assert any(message in str(error) for error in causes), list(chain(caught.value))
    assert len(str(caught.value).splitlines()) <= 10


@pytest.mark.parametrize("message", PRINTED)
def test_a_quoted_line_is_printed(message, folder):
    assert not ROWS[message]
    assert message in PRINTED[message](folder)


def test_each_quoted_message_is_provoked():
    assert PAGE.count("\n| `") == len(ROWS)  # each row has four columns and quotes once
    assert sorted(ROWS) == sorted([*RAISED, *PRINTED])


def test_no_error_class_is_left_out():
    assert len(CLASSES) > 20
    # The conformance suite turns them into results of its cases, so no user meets them.
    shown = set(CLASSES) - {"CaseFailure", "NotJoined"}
    assert [name for name in sorted(shown) if f"`{name}`" not in PAGE] == []
    # Only SceneError is never raised itself.
    assert shown - set(ROWS.values()) == {"SceneError"}
