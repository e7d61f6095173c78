"""Members beside the regions of a world: those for which no frame waits."""

from __future__ import annotations

from minerva_bus.frame import messages as m


def objection(hello: m.Hello, *, makes_all_views: bool) -> str:
    """Reason why a member cannot take part beside the regions; or an empty string.

    `makes_all_views` is false if the coordinator lacks the code of agents, and so of their views.
    """
    if hello.draws and not makes_all_views:
        return "it shows views, for which this coordinator lacks the code of agents in commands"
    if not (hello.kinds or hello.ticks):
        return ""
    if hello.kinds:
        return (
            "it hosts agents, which only regions do in this world; run the regions by themselves"
            " (minerva run --coordinator-only) and connect it to one that listens for hosts"
            " (minerva attach --process region-0 --listen ENDPOINT), or run the world with one"
            " coordinator (--regions 0)"
        )
    return (
        "it runs in step with the frames, which only regions do in this world; run the world with"
        " one coordinator (--regions 0), or send events freely"
    )
