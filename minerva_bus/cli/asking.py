"""`minerva list`, `echo`, `pub`, `stop` and `version`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from minerva_bus.cli.places import client, identity, place
from minerva_bus.cli.saying import say, tell
from minerva_bus.errors import MinervaError, nearest
from minerva_bus.frame.messages import FrameRecord
from minerva_bus.grammar.batch import single
from minerva_bus.grammar.printer import value_text
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.registry import running
from minerva_bus.runtime.client import Client
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.plain import on_screen
from minerva_bus.wording import counted
from minerva_bus.world.operator import MemberStatus, WorldStatus


def list_members(connect: str, world: str, json_too: bool) -> None:
    """Print the members of a world, or the worlds if several run."""
    worlds = running()
    if not connect and not world and len(worlds) != 1:
        if json_too:
            say(json.dumps([{"world": w.world, "endpoint": w.endpoint, "pid": w.pid}
                               for w in worlds]))  # fmt: skip
        elif worlds:
            _table(
                ["world", "endpoint", "pid"], [[w.world, w.endpoint, str(w.pid)] for w in worlds]
            )
        else:
            tell("no world runs on this machine")
        return
    with client(connect, world) as asked:
        status = asked.operator.status()
    if json_too:
        say(json.dumps(listing(status)))
        return
    agents = counted(status.agents, "agent")
    say(f"{status.world}: frame {status.frame} ({_doing(status)}), {agents}")
    _table(
        ["member", "state", "roles", "types", "last reply", "late", "pid", "host", "figures"],
        [_row(member) for member in status.members],
    )
    if status.refused:
        say(f"refused: {', '.join(f'{count} of {who}' for who, count in status.refused.items())}")


def _doing(status: WorldStatus) -> str:
    waiting = f", waiting for {', '.join(status.waiting)}" if status.waiting else ""
    return f"{'paused' if status.paused and not waiting else status.phase}{waiting}"


def listing(status: WorldStatus) -> dict[str, Any]:
    """A status as a JSON object."""
    members = [{"member": each.name, **asdict(each)} for each in status.members]
    for member in members:
        del member["name"]
    return {**asdict(status), "members": members, "happenings": []}


def _row(member: MemberStatus) -> list[str]:
    return [
        member.name,
        member.state,
        " ".join(member.roles),
        " ".join([*member.kinds, *member.generates, *member.draws]),
        str(member.last_reply),
        str(member.late),
        str(member.pid),
        member.host,
        member.figures_shown(),
    ]


def _table(titles: list[str], rows: list[list[str]]) -> None:
    rows = [[on_screen(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(titles, *rows, strict=True)]
    for row in [titles, *rows]:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        say("  ".join(cells).rstrip())


def echo_type(type_: str, connect: str, world: str, count: int, json_too: bool) -> None:
    """Print events, fragments or views of a type as they arrive."""
    own = identity() if connect else None
    endpoint, world = place(connect, world, own)
    with Client(endpoint, world, own) as asked:
        vocabulary = asked.vocabulary()
        declared = vocabulary.events.get(type_)
        if type_ and declared is None and type_ not in vocabulary.kinds:
            known = [*vocabulary.events, *vocabulary.kinds]
            raise MinervaError(
                f"{world} has no event type or agent kind {type_!r}{nearest(type_, known)};"
                f" it has {', '.join(known)}"
            )
        if declared is None or not declared.visual:
            shown = 0
            for record in asked.records():
                for what in _of_interest(record, type_):
                    say(json.dumps(what) if json_too else f"{what['frame']:>7}  {what['text']}")
                    shown += 1
                    if shown == count:
                        return
            return
    _echo_view(type_, endpoint, world, own, count, json_too)


def _of_interest(record: FrameRecord, type_: str) -> Iterator[dict[str, Any]]:
    for event in single(record.events):
        if type_ in ("", event.type):
            data = {name: _plain(value) for name, value in event.data.items()}
            yield {
                "frame": record.frame,
                "type": event.type,
                "data": data,
                "sender": event.sender,
                "receivers": list(event.receivers),
                "text": str(event),
            }
    for agent, scene in sorted(record.changed.items()):
        if type_ and any(node.symbol == type_ for node in scene.nodes):
            yield {"frame": record.frame, "agent": agent, "text": str(scene)}


def _plain(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else value_text(value)


def _echo_view(
    event_type: str,
    endpoint: str,
    world: str,
    own: Credentials | None,
    count: int,
    json_too: bool,
) -> None:
    import os

    from minerva_bus.cli.attaching import leave_on_signals
    from minerva_bus.frame.member import Member
    from minerva_bus.runtime.member import MemberProcess
    from minerva_bus.world.services import Device, View

    class Echo(Device):
        """A geometric system that prints each string."""

        draws = (event_type,)
        every = 1
        shown = 0

        def show(self, view: View) -> None:
            what = {"frame": view.frame, "type": event_type, "text": str(view.scene)}
            say(json.dumps(what) if json_too else f"{view.frame:>7}  {_short(view.scene)}")
            self.shown += 1
            if self.shown == count:
                member.leave()

    name = f"echo-{os.getpid()}" if own is None else own.name
    member = MemberProcess(Member(name, Echo()), world, endpoint, tell, own=own)
    leave_on_signals(member)
    member.run()


def _short(scene: Scene) -> str:
    shown = str(scene)
    return shown if len(shown) < 2000 else shown[:2000] + "…"


def publish(
    type_: str,
    data: list[str],
    to: list[str],
    condition: str,
    connect: str,
    world: str,
    json_too: bool,
) -> None:
    """Send an event."""
    pairs: dict[str, str] = {}
    for word in data:
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise MinervaError(f"what is {word!r}? Expected data as KEY=VALUE")
        pairs[name] = value
    with client(connect, world) as asked:
        answer = asked.ask("pub", type=type_, data=pairs, receivers=to, condition=condition)
    if json_too:
        say(json.dumps(answer))
        return
    through = f" through {', '.join(answer['through'])}" if answer["through"] else ""
    say(f"{answer['event']} sent{through}, after frame {answer['frame']} began")


def stop_world(connect: str, world: str) -> None:
    """Stop a running world."""
    with client(connect, world) as asked:
        asked.ask("stop")
        say(f"{asked.world}: asked to stop")


def show_version(json_too: bool) -> None:
    """Print versions."""
    import platform
    from importlib.metadata import version

    from minerva_bus.frame.compatibility import PROTOCOL_VERSION

    versions: dict[str, Any] = {
        "minerva-bus": version("minerva-bus"),
        "protocol": PROTOCOL_VERSION,
        "python": platform.python_version(),
    }
    for package in ("eclipse-zenoh", "msgpack", "numpy", "pymunk", "typer"):
        versions[package] = version(package)
    if json_too:
        say(json.dumps(versions))
    else:
        _table(["part", "version"], [[name, str(value)] for name, value in versions.items()])
