"""The texts of the dashboard: heading, table rows, bars and panels of a status."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from rich.bar import Bar
from rich.table import Table
from rich.text import Text

from minerva_bus.runtime.operator_client import activity, awaited, types_of
from minerva_bus.wording import counted
from minerva_bus.world.operator import MemberStatus, WorldStatus

PHASES: Final = ("tick", "collect", "evolve", "commit", "view", "encode", "decode")
"""The parts of a frame in their order; the last three are contained in others."""

_STATES: Final = {
    "present": "green",
    "late": "yellow",
    "joining": "cyan",
    "lost": "red",
    "left": "bright_black",
}


def heading(status: WorldStatus) -> Text:
    """World, activity, frame, time and frame rate."""
    return Text.assemble(
        (f" {status.world} ", "bold reverse"),
        "  ",
        doing(status),
        f"   frame {status.frame:,}   {status.time:,.1f} s simulated   ",
        (f"{status.hz:,.0f} Hz", "bold"),
        f" of {status.rate:g}   " if status.rate else "   ",
        f"{counted(status.agents, 'agent')}   {counted(len(status.members), 'member')}   ",
        (_late(status), "yellow"),
    )


def _late(status: WorldStatus) -> str:
    if not status.late_frames:
        return ""
    return f"{counted(status.late_frames, 'late frame')} ({status.behind:.1f} s behind)"


def doing(status: WorldStatus) -> Text:
    """Whether the world runs, is paused, or waits for members."""
    now = activity(status)
    if awaited(status):
        return Text(f"● {now} for {status.waited:.1f} s", "bold red")
    return Text(f"● {now}", "bold yellow" if now == "paused" else "bold green")


def row(member: MemberStatus, longest: float) -> list[Text]:
    """The table row of a member; `longest` is the longest wait for any member, µs."""
    types = types_of(member)
    return [
        Text(member.name, "bold"),
        Text(member.state, _STATES.get(member.state, "")),
        Text(member.service or " ".join(member.roles)),
        Text(types if len(types) <= 30 else types[:29] + "…", "bright_black"),
        Text(f"{member.wait:9,.0f} ").append_text(bar(member.wait, longest, 8)),
        Text(f"{member.late:,}", "yellow" if member.late else "bright_black", justify="right"),
        Text(f"{member.last_reply:,}", justify="right"),
        Text(f"{member.pid}@{member.host}", "bright_black"),
        Text(member.figures_shown(), "yellow" if member.figures.get("dropped") else ""),
    ]


def bar(amount: float, greatest: float, width: int = 16) -> Text:
    """A bar; the greatest amount fills `width` characters."""
    # The bar's last character shows eighths.
    eighths = round(8 * width * amount / greatest) if greatest > 0 else 0
    whole, rest = divmod(min(eighths, 8 * width), 8)
    shown = "█" * whole + (" ▏▎▍▌▋▊▉"[rest] if rest else "")
    return Text(shown.ljust(width), "cyan")


def _wide_bar(amount: float, greatest: float, colour: str = "cyan") -> Bar:
    """A bar in the width that numbers leave: a narrow panel shows shorter ones."""
    return Bar(greatest or 1.0, 0, amount, color=colour)


def phases(status: WorldStatus) -> Table:
    """The time of a frame by part."""
    table = _table()
    frame = status.phases.get("frame", 0.0)
    for name in (phase for phase in PHASES if phase in status.phases):
        amount = status.phases[name]
        table.add_row(name, f"{amount:,.0f} µs", _wide_bar(amount, frame))
    # The other parts lie within these four.
    busy = sum(status.phases.get(name, 0.0) for name in ("tick", "collect", "evolve", "commit"))
    if frame:
        idle = max(0.0, frame - busy)
        table.add_row("idle", f"{idle:,.0f} µs", _wide_bar(idle, frame, "bright_black"))
        table.add_row(Text("frame", "bold"), Text(f"{frame:,.0f} µs", "bold"), "")
    for name, amount in (("bytes in", status.bytes_in), ("bytes out", status.bytes_out)):
        rate = Text(f"{_bytes(amount * status.hz)}/s", no_wrap=True)
        table.add_row(name, _bytes(amount), rate)
    return table


def events(rates: Mapping[str, float], most: int = 12) -> Table:
    """Events per second by type, the most frequent first."""
    table = _table()
    shown = sorted(rates.items(), key=lambda pair: (-pair[1], pair[0]))
    greatest = shown[0][1] if shown else 0.0
    for name, rate in shown[:most]:
        table.add_row(name, f"{rate:,.0f}/s", _wide_bar(rate, greatest, "magenta"))
    if len(shown) > most:
        table.add_row(f"and {len(shown) - most} more types", "", "")
    return table


def _table() -> Table:
    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column()
    return table


def _bytes(amount: float) -> str:
    for unit in ("B", "kB", "MB"):
        if amount < 1000:
            return f"{amount:.0f} {unit}" if unit == "B" else f"{amount:.1f} {unit}"
        amount /= 1000
    return f"{amount:.1f} GB"
