"""Words for people."""

import pytest

from minerva_bus.wording import counted


@pytest.mark.parametrize(
    ("number", "one", "shown"),
    [
        (1, "agent", "1 agent"),
        (0, "agent", "0 agents"),
        (1200, "agent", "1,200 agents"),
        (1, "process", "1 process"),
        (2, "process", "2 processes"),
    ],
)
def test_what_there_is_of_something(number, one, shown):
    assert counted(number, one) == shown
