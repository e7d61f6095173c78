"""A standby takes the name of a member as soon as that cannot return."""

import socket
from types import SimpleNamespace
from typing import Any, cast

import pytest

from minerva_bus.runtime.predecessor import Predecessor
from minerva_bus.runtime.reconnect import ReconnectMonitor
from minerva_bus.runtime.rejoin import SPREAD_SECONDS, STANDBY_SECONDS, Rejoin
from minerva_bus.runtime.system import REAL, System
from minerva_bus.runtime.world_link import WorldLink
from minerva_bus.wire.keys import COORDINATOR, Keys

KEYS = Keys("w")
AT = "tls/a.example:7450"


class Clock(System):
    """Seconds that pass with each look at the clock, and a machine that may refuse links."""

    def __init__(self, refusing):
        self.now, self.refusing = 0.0, refusing

    def monotonic(self):
        self.now += 0.01
        return self.now

    def refuses(self, endpoint):
        assert endpoint == AT
        return self.refusing


class Session:
    """Liveliness tokens: those of the coordinator, and of a region until it ends."""

    def __init__(self, clock, ends):
        self.clock, self.ends = clock, ends

    def liveliness(self):
        return self

    def get(self, key, timeout):
        there = [KEYS.alive(COORDINATOR)]
        if self.clock.now < self.ends:
            there += [KEYS.alive("region-1"), KEYS.link("region-1", AT)]
        about = key.rpartition("/")[0] if key.endswith("*") else key
        keys = [each for each in there if each == key or each.startswith(about + "/")]
        return [SimpleNamespace(ok=SimpleNamespace(key_expr=each)) for each in keys]


@pytest.mark.parametrize(("refusing", "least", "most"), [
    (True, 0.0, SPREAD_SECONDS + 0.5),
    (False, STANDBY_SECONDS - 0.5, STANDBY_SECONDS + SPREAD_SECONDS + 0.5),
])  # fmt: skip
def test_a_standby_waits_only_for_a_process_that_may_return(refusing, least, most):
    clock = Clock(refusing)
    session = cast("Any", Session(clock, 3.0))
    link = WorldLink(KEYS, "region-1", print, clock.monotonic)
    monitor = ReconnectMonitor("w", 5.0, str, print, print, clock)
    rejoin = Rejoin("region-1", monitor, link, print, print, clock)
    for _ in rejoin.stand_by(session, Predecessor("region-1", KEYS, clock)):
        pass
    assert least <= clock.now - session.ends <= most


def test_only_a_machine_that_answers_refuses_links():
    with socket.create_server(("127.0.0.1", 0)) as server:
        at = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        assert not REAL.refuses(at)
    assert REAL.refuses(at)
    assert not REAL.refuses("tcp/no-such-host.invalid:7450")
    assert not REAL.refuses("unixsock-stream//tmp/none.sock")
