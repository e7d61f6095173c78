"""`minerva list`, `echo` and `version`: queries, with their tables and JSON objects."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import print_json, print_message, print_result, print_table
from minerva_bus.cli.places import client, identity, place
from minerva_bus.errors import MinervaError, nearest
from minerva_bus.frame.messages import FrameRecord
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.text_and_digest import json_value
from minerva_bus.launch.registry import running
from minerva_bus.runtime.operator_client import Client, status_object, types_of
from minerva_bus.security.credentials import Credentials
from minerva_bus.wording import counted
from minerva_bus.world.operator import MemberStatus, WorldStatus


def list_members(target: WorldTarget, as_json: bool) -> None:
    """Print the members of a world, or the worlds if several run."""
    worlds = running()
    if not target.connect and not target.world and len(worlds) != 1:
        if as_json:
            print_json([asdict(world) for world in worlds])
        elif worlds:
            rows = [(w.world, w.endpoint, str(w.pid)) for w in worlds]
            print_table([("world", "endpoint", "pid"), *rows])
        else:
            print_message(
                "no world runs on this machine; elsewhere: minerva list --connect ENDPOINT"
            )
        return
    with client(target) as connected:
        status = connected.operator.status()
    if as_json:
        print_json(listing(status))
        return
    agents = counted(status.agents, "agent")
    print_result(f"{status.world}: frame {status.frame} ({_doing(status)}), {agents}")
    print_table([_TITLES, *map(_row, status.members)])
    if status.refused:
        print_result(
            f"refused: {', '.join(f'{count} of {who}' for who, count in status.refused.items())}"
        )


_TITLES = ["member", "state", "roles", "types", "last reply", "late", "pid", "host", "figures"]


def _doing(status: WorldStatus) -> str:
    waiting = f", waiting for {', '.join(status.waiting)}" if status.waiting else ""
    return f"{'paused' if status.paused and not waiting else status.phase}{waiting}"


def listing(status: WorldStatus) -> dict[str, Any]:
    """A status as a JSON object."""
    shown = status_object(status)
    members = [{"member": member.pop("name"), **member} for member in shown["members"]]
    return {**shown, "members": members}


def _row(member: MemberStatus) -> list[str]:
    return [
        member.name,
        member.state,
        " ".join(member.roles),
        types_of(member),
        str(member.last_reply),
        str(member.late),
        str(member.pid),
        member.host,
        member.figures_shown(),
    ]


def echo_type(type_: str, target: WorldTarget, count: int, as_json: bool) -> None:
    """Print events, fragments or views of a type as they arrive."""
    own = identity() if target.connect else None
    endpoint, world = place(target, own)
    with Client(endpoint, world, own) as connected:
        vocabulary = connected.vocabulary()
        declared = vocabulary.events.get(type_)
        if type_ and declared is None and type_ not in vocabulary.kinds:
            known = [*vocabulary.events, *vocabulary.kinds]
            hint = nearest(type_, known, f"it has {', '.join(known)}")
            raise MinervaError(f"{world} has no event type or agent kind {type_!r}{hint}")
        # Records of frames have events and changed agents. Views reach devices only, so for a
        # visual type this command joins as one.
        if declared is None or not declared.visual:
            shown = 0
            for record in connected.records():
                for entry in _entries(record, type_):
                    text = f"{entry['frame']:>7}  {entry['text']}"
                    print_result(json.dumps(entry) if as_json else text)
                    shown += 1
                    if shown == count:
                        return
            return
    _echo_view(type_, endpoint, world, own, count, as_json)


def _entries(record: FrameRecord, type_: str) -> Iterator[dict[str, Any]]:
    for event in single(record.events):
        if type_ in ("", event.type):
            data = {name: json_value(value) for name, value in event.data.items()}
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


def _echo_view(
    event_type: str, endpoint: str, world: str, own: Credentials | None, count: int, as_json: bool
) -> None:
    import os

    from minerva_bus.cli.attaching import leave_on_signals
    from minerva_bus.frame.member_side import Member
    from minerva_bus.runtime.participants import MemberProcess
    from minerva_bus.world.services import Device, View

    class Echo(Device):
        """A geometric system that prints each string."""

        draws = (event_type,)
        when = "each frame"
        shown = 0

        def show(self, view: View) -> None:
            entry = {"frame": view.frame, "type": event_type, "text": str(view.scene)}
            text = f"{view.frame:>7}  {_short(view.scene)}"
            print_result(json.dumps(entry) if as_json else text)
            self.shown += 1
            if self.shown == count:
                member.leave()

    # The number of the process makes the name unique, so several can watch.
    name = f"echo-{os.getpid()}" if own is None else own.name
    member = MemberProcess([Member(name, Echo())], world, endpoint, print_message, own=own)
    leave_on_signals(member)
    member.run()


def _short(scene: Scene) -> str:
    shown = str(scene)
    return shown if len(shown) < 2000 else shown[:2000] + "…"
