"""Growth by counts: how many calls a function makes, which no machine and no load changes."""

import sys


def calls(function):
    """How many functions of Python and C a function calls, without its first run, which fills caches."""
    count = 0

    def see(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    function()
    before = sys.getprofile()
    sys.setprofile(see)
    try:
        function()
    finally:
        sys.setprofile(before)
    return count
