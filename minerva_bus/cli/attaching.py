"""`minerva attach`."""

from __future__ import annotations

import signal
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Final

from minerva_bus.blame import report
from minerva_bus.cli.exit_codes import FAILED
from minerva_bus.cli.places import identity, place
from minerva_bus.cli.saying import tell
from minerva_bus.errors import KeysError, WorldFileError, nearest
from minerva_bus.frame.member import Member, WorldRestarted
from minerva_bus.launch.interrupts import end_signals
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.specs import (
    AGENTS,
    bind,
    entries,
    find_agents,
    find_service,
    find_world,
    load,
)
from minerva_bus.launch.typed import typed_options
from minerva_bus.runtime.diagnosis import check_reachable
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.runtime.member import BACK_WITHIN, MemberProcess
from minerva_bus.runtime.session import CONNECT_SECONDS, end_at_once
from minerva_bus.settings.overrides import Overrides
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Device

KEEP_TRYING: Final = 600.0


@dataclass(frozen=True, slots=True)
class ConnectOptions:
    """How to reach a world: endpoint, name, and seconds to try to reconnect.

    A local world that is restarted listens at another endpoint, so its time is short.
    """

    connect: str = ""
    world: str = ""
    keep_trying: float | None = None

    def back_within(self, local: bool) -> float:
        """Seconds to try to reconnect."""
        if self.keep_trying is not None:
            return self.keep_trying
        return BACK_WITHIN if local else KEEP_TRYING


def attach_member(
    spec: str, way: ConnectOptions, name: str, options: dict[str, str], process: str = ""
) -> int:
    """Run a member until the world, its source or the user ends it; returns the exit code.

    Without `name`, the member has the name in its certificate.
    """
    shown = identity() if way.connect and not name and not process else None
    name = name if shown is None else shown.name
    while True:
        if process:
            participant = _of_file(spec, process, name, options)
        else:
            participant = _participant(spec, name, options)
        try:
            return _attached(participant, way)
        except WorldRestarted as restarted:
            tell(f"{participant.name}: {restarted}; joining again")


def _attached(participant: Member, way: ConnectOptions) -> int:
    connect, world = way.connect, way.world
    own = identity(participant.name) if connect else None
    if own is not None and own.name != participant.name:
        raise KeysError(f"the certificate is of {own.name}: attach with --name {own.name}")
    endpoint, world = place(connect, world, own)
    there = check_endpoint(endpoint)
    if not there.local:  # Before Ctrl-C is handled as leaving, because this can take long.
        check_reachable(there, CONNECT_SECONDS)

    service = participant.service
    ends = not isinstance(service, Device)
    within = way.back_within(there.local)
    member = MemberProcess(
        participant, world, endpoint, tell, own=own, ends=ends, back_within=within
    )
    leave_on_signals(member)
    tell(f"{participant.name}: joining {world} at {endpoint}; Ctrl-C leaves")
    code = min(member.run(), FAILED) or int(getattr(service, "failed", False))
    if member.failure is not None:
        tell(f"{participant.name}: failed: {report(member.failure)}")
    if participant.stopped:
        tell(f"{participant.name}: the world has ended: {participant.stopped}")
    end_at_once(code)
    return code


def bridge_source(
    kind: str, source: str, way: ConnectOptions, name: str, options: dict[str, str]
) -> int:
    """Connect a source to a running world until either ends, or Ctrl-C; returns the exit code."""
    option = getattr(find_service(kind, Path.cwd()), "source_option", "")
    if source and not option:
        raise WorldFileError(f"{kind} takes no source; see its options")
    if source:
        path = Path(source)  # Not resolved: a link to a device may have another target later.
        options = {**options, option: str(path.absolute()) if path.exists() else source}
    return attach_member(kind, way, name, options)


def leave_on_signals(member: MemberProcess) -> None:
    """Leave the world on a signal that ends a process; a second signal terminates at once."""

    def leave(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        member.leave()

    for number in end_signals():
        signal.signal(number, leave)


def _participant(spec: str, name: str, options: dict[str, str]) -> Member:
    import os

    folder = Path.cwd()
    short = spec.rpartition(":")[2].rpartition(".")[2].lower()
    name = name or f"{short}-{os.getpid()}"
    if _names_agents(spec, folder):
        if options:
            raise WorldFileError(f"{spec} names agents, which have no options")
        return Member(name, None, find_agents(spec, folder))
    service = find_service(spec, folder)
    return Member(name, bind(service, typed_options(service, options), name)())


def _of_file(spec: str, process: str, name: str, options: dict[str, str]) -> Member:
    """The process of a world file with this name. Raises WorldFileError if there is none."""
    file = read_world_file(find_world(spec), Overrides(options=options))
    known = {each.name: each for each in file.processes}
    if process not in known:
        raise WorldFileError(
            f"{file.path}: there is no process {process!r}{nearest(process, list(known))};"
            f" there are {', '.join(known)}"
        )
    if known[process].command:
        raise WorldFileError(f"{process} is a command: run it itself, with MINERVA_CONNECT set")
    return replace(known[process], name=name or process).participant()


def _names_agents(spec: str, folder: Path) -> bool:
    if ":" not in spec:
        return spec in entries(AGENTS)
    cls = load(spec, folder)
    return isinstance(cls, type) and issubclass(cls, Agent)
