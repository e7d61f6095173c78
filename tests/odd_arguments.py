"""Values of wrong types for public functions."""

from minerva_bus import MinervaError
from tests.api.frogs import Frog

ODD = (None, 3, -1, 10**30, float("nan"), "x", b"x", "\ud800", "\0", [], {}, {1: 2}, object(), Frog)
"""Some of them are valid for some of the arguments."""


def check_refusals(call):
    """Call with all odd values: some are refused, by an error of ours."""
    refused = 0
    for odd in ODD:
        try:
            call(odd)
        except MinervaError as error:
            assert str(error).strip()
            refused += 1
    assert refused
