"""Words for people that more than one layer needs."""

from collections.abc import Sequence


def counted(number: int, one: str) -> str:
    """A number and what there is of it: `1 agent`, `1,200 agents`, `2 processes`."""
    ending = "" if number == 1 else "es" if one.endswith("s") else "s"
    return f"{number:,} {one}{ending}"


def named_some(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are: `a, b and 7 more`."""
    more = f" and {len(names) - most:,} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def frames_up_to(end: int) -> str:
    """The frames before `end`: `no frames`, `frame 0`, `the frames 0 to 12`."""
    if end <= 1:
        return "frame 0 only" if end == 1 else "no frames"
    return f"the frames 0 to {end - 1}"
