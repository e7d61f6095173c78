"""Members in threads of this process: faster to start than programs."""

import threading
from collections.abc import Callable, Mapping

from naive import NaiveMember

from minerva_bus.frame.member_side import Member
from minerva_bus.runtime.participants import MemberProcess
from minerva_conformance.launching import RunningMember, StartMember
from minerva_conformance.world import MemberRole, reference
from tests.patience import patience


class ThreadMember:
    """A function that runs in a thread; its result is the exit code. `stop` makes it return."""

    def __init__(self, run: Callable[[], int], stop: Callable[[], None]) -> None:
        self._stop = stop
        self._code: int | None = None
        self._thread = threading.Thread(target=self._run, args=(run,), daemon=True)
        self._thread.start()

    def _run(self, run: Callable[[], int]) -> None:
        try:
            self._code = run()
        except (Exception, SystemExit):  # A broken member may fail in any way.
            self._code = 1

    def code(self, within: float) -> int | None:
        self._thread.join(within)
        return self._code

    def interrupt(self) -> None:
        self._stop()

    def kill(self) -> None:
        self._stop()
        self._thread.join(patience(10))

    def output(self) -> str:
        return ""


def own_member(role: MemberRole | None = None) -> StartMember:
    """Starts the reference as a member on the bus, in the role of the environment."""

    def start(environment: Mapping[str, str]) -> RunningMember:
        member: Member = reference(MemberRole(environment.get("MINERVA_ROLE", role)))
        world, endpoint = environment["MINERVA_WORLD"], environment["MINERVA_CONNECT"]
        process = MemberProcess([member], world, endpoint, lambda line: None)
        return ThreadMember(process.run, process.leave)

    return start


def naive_member(kind: type[NaiveMember] = NaiveMember) -> StartMember:
    """Starts a naive member, or a broken one."""

    def start(environment: Mapping[str, str]) -> RunningMember:
        member = kind(environment)
        return ThreadMember(member.run, member.stop)

    return start
