"""The status line: frame, rate and selection."""

from minerva_bus.world.operator import WorldStatus

_LONG = 1.0
"""Waiting time in seconds from which it is shown; short waits are normal."""


def caption(frame: int, dt: float, status: WorldStatus | None, doing: str = "") -> str:
    """Frame, time and rate; `doing` is appended."""
    parts = [f"frame {frame}", f"{frame * dt:.1f} s"] if frame >= 0 else ["no view yet"]
    if status is not None:
        parts.append("paused" if status.paused else pace(status))
        if status.waiting and status.waited > _LONG:
            parts.append(f"waiting for {', '.join(status.waiting)}")
    return "  ·  ".join([*parts, *([doing] if doing else [])])


def pace(status: WorldStatus) -> str:
    """Frames per second, and the target rate if that is higher."""
    reached = f"{status.hz:.0f}"
    wanted = f" of {status.rate:g}" if status.rate and status.hz < 0.9 * status.rate else ""
    return f"{reached}{wanted} frames a second"
