"""A secured world, and members that try to join it."""

import sys
import threading
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from running import MEMBERS, World, eventually, write_world

from minerva_bus.frame.member_side import Member
from minerva_bus.runtime.operator_client import Client
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.security.credentials import Credentials
from minerva_certificates import AuthorityFolder, Wanted
from tests.patience import patience

LISTEN = "tls/127.0.0.1:0"


def keyed_world(folder, issue, bus="", members=MEMBERS, listen=LISTEN, **world):
    """A world file with keys beside it; `issue` maps names to the requested certificates."""
    keys = AuthorityFolder(folder / "keys")
    keys.init()
    for name, wanted in issue.items():
        keys.issue(name, Wanted(**wanted))
    bus = f'listen = "{listen}"\nkeys = "keys"\n{bus}'
    return write_world(folder, members, bus=bus, **world), keys


def secured_endpoint(world):
    """The endpoint of a world for processes other than its own."""
    line = world.says("coordinator │ listens at")
    return line.partition("listens at ")[2].partition(";")[0]


def stolen(folder, name, roles=()):
    """Credentials from the files of a name, even if they are expired or revoked."""
    return Credentials(
        name, folder / "ca.pem", folder / f"{name}.pem", folder / f"{name}.key", frozenset(roles)
    )


class Joined:
    """A member in a thread of this process."""

    def __init__(self, world, endpoint, own, service=None, agents=(), kind=MemberProcess):
        self.told, self.result, self.over = [], None, threading.Event()
        participant = Member(own.name, service, agents)
        self.member = kind([participant], world.name, endpoint, self.told.append, own=own)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        try:
            self.result = self.member.run()
        except BaseException as error:
            self.result = error
        self.over.set()

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.member.leave()
        self._thread.join(patience(10))

    def ends(self):
        return eventually(lambda: self.result is not None and str(self.result), "it ends")


def status(world):
    with world.client() as asked:
        return asked.operator.status()


def present(world, name):
    eventually(lambda: world.members().get(name, {}).get("state") == "present", f"{name} is in")


def refused(world, who):
    return status(world).refused.get(who, 0)


def goes_on(world):
    assert world.process.poll() is None, world.text
    before = status(world).frame
    eventually(lambda: status(world).frame > before + 3, "the world goes on")


__all__ = [
    "AuthorityFolder",
    "Client",
    "Joined",
    "Wanted",
    "World",
    "eventually",
    "goes_on",
    "keyed_world",
    "present",
    "refused",
    "secured_endpoint",
    "status",
    "stolen",
]  # fmt: skip
