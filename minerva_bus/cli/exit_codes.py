"""Exit codes of `minerva`; 0 means success."""

from typing import Final

FAILED: Final = 1
"""A check or a world failed."""
WRONG: Final = 2
"""The input is wrong."""
INTERRUPTED: Final = 130
"""Interrupted by Ctrl-C: the convention of shells for SIGINT."""
