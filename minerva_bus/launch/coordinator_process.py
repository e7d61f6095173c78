"""The coordinator's process: it runs a world, reports to the launcher and reads its commands.

It opens the world to other machines, with certificates. After a crash another coordinator continues
from the journal.
"""

from __future__ import annotations

import os
import threading
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from minerva_bus.errors import BusError, Followed, KeysError, WorldFileError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import PART, Fragment
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.messages import Fragments
from minerva_bus.frame.placement import kinds_of
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.child_processes import LineBuffer, ReportPipe
from minerva_bus.launch.console import EndReport
from minerva_bus.launch.process_specs import ProcessSpec, forgotten
from minerva_bus.launch.registry import runtime_folder
from minerva_bus.launch.run_outputs import (
    RunJournal,
    collect_sink,
    find_past,
    monitored,
    next_epoch,
    recording,
)
from minerva_bus.launch.world_files import Access, WorldFile
from minerva_bus.log.journal import resume_from
from minerva_bus.runtime.admission import LOCAL_KIND, ListenConfig, Security
from minerva_bus.runtime.coordinator import Coordinator, Printed, Started, Watchers
from minerva_bus.runtime.session import REAL, System, run_through
from minerva_bus.runtime.transport import overhear
from minerva_bus.security.credentials import Rights, family_start, key_folder, rights_of
from minerva_bus.wire.codec import encode
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.plain import DEFAULT
from minerva_bus.wording import counted

MAX_BYTES: Final = DEFAULT.message_bytes
"""Size of the largest message that a member reads."""

MAX_PATH_BYTES: Final = 100
"""Longest path of a socket: systems accept 104 to 108; Zenoh adds a lock file beside it."""


@dataclass(frozen=True, slots=True)
class CoordinatorStart:
    """Arguments of a coordinator's process; `again`: it succeeds another one.

    `make` creates the coordinator; `queued` are the members that have not been started yet.
    """

    file: WorldFile
    make: Callable[..., Coordinator]
    profile: bool
    shared: bool
    again: bool
    queued: frozenset[str]


def run_coordinator(start: CoordinatorStart, reports: ReportPipe, commands: int) -> int:
    """Run a world's coordinator; `commands` is a pipe. Returns the exit code."""
    run = CoordinatorRun(start, reports)
    # A daemon, because its read returns only when the launcher closes the pipe.
    threading.Thread(target=_read_commands, args=(commands, run.coordinator), daemon=True).start()
    with monitored(start.file, run.coordinator.ask, lambda text: reports.send("note", text=text)):
        return run_through(run.life())


class CoordinatorRun:
    """A coordinator's part of a run, from the end of its predecessor.

    It passes the notices of the coordinator to launcher, record, tables and journal.
    """

    coordinator: Coordinator

    def __init__(self, start: CoordinatorStart, reports: ReportPipe, system: System = REAL) -> None:
        """Raises RecordError and BusError if the coordinator cannot begin."""
        file = start.file
        self._local = [process.name for process in file.processes if not process.elsewhere]
        self._reports = reports
        self._began = False
        self._members = 0
        # The world of a journal begins with its keyframe, so everything below works on that state.
        past = find_past(file, again=start.again)
        algorithm = FrameAlgorithm(file.world if past is None else past.world)
        # Before any member starts: one that cannot read its fragments would fail at each restart.
        check_sizes(algorithm.composition.fragments, file.processes)
        # Record and tables come first: they get the frames that are only in the journal while the
        # algorithm catches up.
        self._record = recording(file, algorithm, self._say, again=past is not None)
        self._collected = collect_sink(file.collect, algorithm, self._note, again=past is not None)
        if past is not None:
            resume_from(past, algorithm, self._write)
            # The new journal begins at this frame.
            self._save()
            lost = f"; {past.lost:,} bytes at its end are unreadable" if past.lost else ""
            self._note(f"continuing from frame {algorithm.frame} of its journal{lost}")
            # The members of a successor have kept their state.
            for line in () if start.again else forgotten(file.processes):
                self._note(line)
        self.coordinator = start.make(
            file.world,
            self._watchers(),
            rate=file.rate,
            where=ListenConfig(
                file.bus.listen,
                start.shared,
                file.access.routers,
                security(file.access, file.world.name, self._local),
            ),
            deadlines=file.deadlines,
            limits=file.access.limits,
            keep=start.profile,
            epoch=next_epoch(past, system.time()),
            algorithm=algorithm,
            queued=start.queued,
            system=system,
        )
        self._journal = RunJournal(file, self.coordinator, past, self._say)

    def life(self) -> Generator[None, None, int]:
        """Run the world to its end, one turn of the loop per iteration; returns the exit code."""
        try:
            yield from self.coordinator.life()
        except Followed:
            # Its files belong to the other coordinator now.
            self._reports.send("followed")
            raise
        finally:
            # The report about the end starts the launcher's deadline for all processes, this one
            # included, so all files are closed before it. An exception closes them, too.
            self._record.close()
            self._journal.close()
        # Not after an exception: a successor continues the tables.
        if self._collected is not None:
            self._collected.close()
        self._report()
        return 0

    def _watchers(self) -> Watchers:
        """The callbacks for the coordinator."""
        send = self._reports.send
        return Watchers(
            said=self._log,
            status=lambda now: send("status", **asdict(now)),
            listening=lambda endpoint: send(
                "listening", endpoint=endpoint, listens_at=self.coordinator.admission.listens_at
            ),
            stalled=lambda member, waited: send("timed_out", member=member, waited=waited),
            came=lambda member: send("joined", member=member),
            frame_done=self._frame_done,
            idle=self._record.idle,
            # The journal is opened later, because it needs the coordinator.
            operated=lambda: self._journal.operated(),
            stopping=lambda notice: send("stopping", reason=notice.reason),
            restart=lambda member: self._request("restart", member, "restart it there"),
            stack=lambda member: self._request("stack", member, "its stack is not known here"),
            opened=self._opened,
            noted=self._record.noted,
            files=lambda: (
                *self._record.files,
                *self._journal.files,
                *(() if self._collected is None else self._collected.files),
            ),
            collected=None if self._collected is None else self._collected.history,
        )

    def _request(self, kind: str, member: str, otherwise: str) -> str:
        """Request something about a member of the launcher, or return why not."""
        if member not in self._local:
            return f"{member} runs on another machine: {otherwise}"
        self._reports.send(kind, member=member)
        return ""

    def _opened(self, session: Any) -> list[Any]:
        record, keys = self._record, self.coordinator.keys
        # Sensor topics travel directly between members, so the record needs subscriptions of its
        # own.
        return overhear(session, keys, record.topics, record.heard) if record.topics else []

    def _write(self, done: s.FrameDone) -> None:
        """Write a frame to the record and the tables."""
        self._record.frame_done(done)
        if self._collected is not None:
            self._collected.frame_done(done)

    def _frame_done(self, done: s.FrameDone) -> None:
        # The journal first: a successor can restore the record from it, not the reverse.
        self._journal.frame(done)
        self._write(done)
        # Last, because it saves the rows of this frame, too.
        self._journal.shorten(self._save)
        if not self._began:
            self._began = True
            self._members = len(self.coordinator.algorithm.members.index.active)
            at = self.coordinator.schedule.last_frame_at
            self._reports.send("first_frame", frame=done.frame, at=at)

    def _note(self, text: str) -> None:
        self._reports.send("note", text=text)

    def _say(self, text: str) -> None:
        """Log a line about the record or the journal."""
        self._reports.send("log", member="record", text=text)
        # A record is opened before there is a coordinator, which keeps the lines for `logs`.
        if (coordinator := getattr(self, "coordinator", None)) is not None:
            coordinator.inbox.put(Printed("record", text, "warning"))

    def _save(self) -> None:
        """Save what another successor could not repeat: record and rows up to the last frame."""
        self._record.save()
        if self._collected is not None:
            self._collected.save()

    def _log(self, member: str, text: str, details: str) -> None:
        self._record.said(member, f"{text}\n{details}" if details else text)
        self._reports.send("log", member=member, text=text, details=details)

    def _report(self) -> None:
        """Report the end of the world."""
        # The maximum over time, because some have left before the end.
        members = max(self._members, self.coordinator.status.most_members)
        self._reports.send("ended", **asdict(EndReport.of(self.coordinator, members)))


def _read_commands(commands: int, coordinator: Coordinator) -> None:
    lines = LineBuffer()
    while data := os.read(commands, 4096):
        for line in lines.feed(data):
            handle_command(line, coordinator)


def handle_command(line: str, coordinator: Coordinator) -> None:
    """Handle a command of the launcher; may be called from any thread."""
    # The inbox is the only part of a coordinator that other threads may touch.
    word, _, rest = line.partition(" ")
    if word == "log":
        level, member, text = rest.split(" ", 2)
        coordinator.inbox.put(Printed(member, text, level))
    elif word == "started":
        coordinator.inbox.put(Started(rest))
    elif word == "abandoned":
        coordinator.inbox.put(s.Abandoned(rest))
    elif word == "end":
        coordinator.inbox.put(s.End(rest))
    elif word == "stop":
        coordinator.inbox.put(s.End("interrupted", hurried=True))


def check_sizes(fragments: Mapping[str, Fragment], processes: Iterable[ProcessSpec]) -> None:
    """Raise WorldFileError if a host would receive a message that it cannot read.

    It would fail at each restart. Fragments of the same kinds are distributed among all processes
    that offer them, so one of these gets at least an equal share. Hosts that may be attached later
    do not count.
    """
    offers = [_offered(process) for process in processes if process.agents]
    for kinds, group in _by_kinds(fragments).items():
        hosts = sum(kinds <= offered for offered in offers)
        size = _size(group)
        if hosts and size > MAX_BYTES * hosts:
            more = f"Use {-(-size // MAX_BYTES)} or more processes for them, or start"
            agents = f"the agents of {', '.join(sorted(kinds))} are"
            raise WorldFileError(_text(agents, size, f" for {counted(hosts, 'process')}", more))
        for name in group if hosts and size > MAX_BYTES else ():
            # A part of a population can be divided further, an agent with its scope cannot.
            own = 0 if name.startswith(PART) else _size({name: group[name]})
            if own > MAX_BYTES:
                raise WorldFileError(_text(f"the agent {name} with its scope is", own, "", "Start"))


def _offered(process: ProcessSpec) -> frozenset[str]:
    hello = Member(process.name, None, process.agents).hello()
    return frozenset(kind.name for kind in hello.kinds)


def _by_kinds(fragments: Mapping[str, Fragment]) -> Mapping[frozenset[str], dict[str, Fragment]]:
    groups: defaultdict[frozenset[str], dict[str, Fragment]] = defaultdict(dict)
    for name, node in fragments.items():
        groups[kinds_of(node)][name] = node
    return groups


def _size(group: Mapping[str, Fragment]) -> int:
    return len(encode(Fragments({name: Scene((node,)) for name, node in group.items()})))


def _text(what: str, size: int, shared: str, more: str) -> str:
    return (
        f"{what} {size:,} bytes on the bus{shared}; a message is limited to {MAX_BYTES:,}."
        f" {more} with a shorter string"
    )


def security(access: Access, world: str, started: Iterable[str] = ()) -> Security | None:
    """Security of the coordinator's session. Raises KeysError and, for the socket, BusError.

    Local processes connect through a socket in a folder that only its owner can open. No family of
    certificates may contain the name of a process that the world has `started`.
    """
    if access.keys is None:
        return None
    keys = key_folder(access.keys)
    own = keys.credentials(COORDINATOR)
    _check_families(keys.rights(), started)
    # `rights` and `stamp` are functions, because certificates are issued and revoked while the
    # world runs.
    return Security(own, local_endpoint(world), keys.rights, keys.stamp)


def _check_families(rights: Mapping[str, Rights], started: Iterable[str]) -> None:
    for member in started:
        granted = rights_of(member, rights)
        if granted is not None and family_start(granted.name) and not granted.revoked:
            raise KeysError(
                f"{granted.name} allows others to act as {member}, a process that the world starts:"
                " rename either of them"
            )


def local_endpoint(world: str) -> str:
    """The endpoint at which local processes reach a secured world. Raises BusError."""
    folder = runtime_folder()
    path = str((folder / f"{world}.sock").absolute())
    if len(os.fsencode(path)) > MAX_PATH_BYTES:
        raise BusError(
            f"{path} is too long for a socket ({MAX_PATH_BYTES} bytes); set MINERVA_RUNTIME_DIR to"
            " a folder with a shorter path"
        )
    try:
        status = folder.stat()
    except OSError as error:
        raise BusError(f"cannot use {folder} for running worlds: {error.strerror}") from None
    # Stricter than `check_runtime_folder`: any user who can search the folder can open the socket,
    # and the local link has no certificates.
    if status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise BusError(
            f"{folder} is accessible to other users, who could join the world through it; chmod 700"
            " it, or set MINERVA_RUNTIME_DIR to another folder"
        )
    return f"{LOCAL_KIND}/{path}"
