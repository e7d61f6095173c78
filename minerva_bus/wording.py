"""Words for people that more than one layer needs."""


def counted(number: int, one: str) -> str:
    """A number and what there is of it: `1 agent`, `1,200 agents`, `2 processes`."""
    ending = "" if number == 1 else "es" if one.endswith("s") else "s"
    return f"{number:,} {one}{ending}"
