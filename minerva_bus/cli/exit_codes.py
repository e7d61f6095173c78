"""Exit codes of `minerva`; 0 is for what is done."""

from typing import Final

FAILED: Final = 1
"""A check or a world failed."""
WRONG: Final = 2
"""The input is wrong."""
INTERRUPTED: Final = 130
"""Ctrl-C ended it, as a shell says it of SIGINT."""
