"""The line that says what is seen: the frame, the pace, and what is selected."""

from minerva_bus.world.operator import WorldStatus

_LONG = 1.0
"""Seconds; a frame always waits for somebody a little."""


def caption(frame: int, dt: float, status: WorldStatus | None, doing: str = "") -> str:
    """Of the frame that is seen, so many frames a second, paused or not; `doing` at the end."""
    said = [f"frame {frame}", f"{frame * dt:.1f} s"] if frame >= 0 else ["no view yet"]
    if status is not None:
        said.append("paused" if status.paused else pace(status))
        if status.waiting and status.waited > _LONG:
            said.append(f"waiting for {', '.join(status.waiting)}")
    return "  ·  ".join([*said, *([doing] if doing else [])])


def pace(status: WorldStatus) -> str:
    """Frames a second, and those that are wanted where they are more."""
    reached = f"{status.hz:.0f}"
    wanted = f" of {status.rate:g}" if status.rate and status.hz < 0.9 * status.rate else ""
    return f"{reached}{wanted} frames a second"
