"""A standby takes the name of a member that has gone; of several, one does."""

import random
import threading
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, cast

import pytest

from minerva_bus.errors import BusError
from minerva_bus.runtime.joining import (
    NAME_FREE_AGAIN,
    STANDBY_SECONDS,
    NameToken,
    ReconnectMonitor,
    Rejoin,
    WorldLink,
)
from minerva_bus.runtime.session import System
from minerva_bus.wire.keys import COORDINATOR, Keys
from tests.patience import patience

KEYS = Keys("w")


class Clock(System):
    """Seconds that pass with each look at the clock."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        self.now += 0.01
        return self.now


class Session:
    """Liveliness tokens: those of the coordinator, and of a member until it ends."""

    def __init__(self, clock, ends):
        self.clock, self.ends = clock, ends

    def liveliness(self):
        return self

    def get(self, key, timeout):
        there = [KEYS.alive(COORDINATOR)]
        if self.clock.now < self.ends:
            there.append(KEYS.alive("robot"))
        about = key.rpartition("/")[0] if key.endswith("*") else key
        keys = [each for each in there if each == key or each.startswith(about + "/")]
        return [SimpleNamespace(ok=SimpleNamespace(key_expr=each)) for each in keys]


def test_a_standby_waits_for_a_process_that_may_return():
    clock = Clock()
    session = cast("Any", Session(clock, 3.0))
    link = WorldLink(KEYS, "robot", print, clock.monotonic)
    monitor = ReconnectMonitor("w", 5.0, str, print, print, clock)
    rejoin = Rejoin("robot", monitor, link, print, print, clock)
    for _ in rejoin.stand_by(session):
        pass
    assert STANDBY_SECONDS - 0.5 <= clock.now - session.ends <= STANDBY_SECONDS + 0.5


class Hub:
    """The liveliness tokens of all sessions, which act in turns in a random order."""

    def __init__(self, seed):
        self.tokens, self.now = [KEYS.alive(COORDINATOR)], 0.0
        self._random = random.Random(seed)
        self._turns = threading.Condition()
        self._waiting, self._running = {}, 0

    def begin(self, act):
        """Run a process in a thread; it waits for its first turn."""
        with self._turns:
            self._running += 1
        thread = threading.Thread(target=self._run, args=(act,), daemon=True)
        thread.start()
        return thread

    def _run(self, act):
        self.turn()
        with suppress(BusError):
            act()
        with self._turns:
            self._running -= 1
            self._choose()

    def turn(self):
        """Wait until it is this thread's turn."""
        with self._turns:
            ticket = object()
            self._waiting[ticket] = False
            self._choose()
            self._turns.wait_for(lambda: self._waiting[ticket])
            del self._waiting[ticket]
            self.now += 0.01

    def _choose(self):
        if self._waiting and len(self._waiting) == self._running:
            self._waiting[self._random.choice([*self._waiting])] = True
            self._turns.notify_all()


class Link:
    """A session of one process with the hub; each call is a turn."""

    def __init__(self, hub):
        self.hub = hub

    def liveliness(self):
        return self

    def get(self, key, timeout):
        self.hub.turn()
        matches = [each for each in self.hub.tokens if _includes(key, each)]
        return [SimpleNamespace(ok=SimpleNamespace(key_expr=each)) for each in matches]

    def declare_token(self, key):
        self.hub.turn()
        self.hub.tokens.append(key)
        return SimpleNamespace(undeclare=lambda: self._undeclare(key))

    def _undeclare(self, key):
        self.hub.turn()
        self.hub.tokens.remove(key)


class Ticking(System):
    """The clock of the hub, on whose turns it depends."""

    def __init__(self, hub):
        self.hub = hub

    def monotonic(self):
        return self.hub.now

    def sleep(self, seconds):
        until = self.hub.now + seconds
        while self.hub.now < until:
            self.hub.turn()


def _includes(pattern, key):
    start, star, _ = pattern.partition("*")
    return key.startswith(start) if star else key == pattern


@pytest.mark.parametrize("seed", range(40))
def test_of_processes_that_find_a_name_free_one_takes_it(seed):
    """Those that stand by wait until it has gone; then another one takes it."""
    hub, draw = Hub(seed), random.Random(seed)
    holders, most, standbys = [], [0], draw.randint(1, 4)
    name = KEYS.alive("robot")

    def hold(number, session, token):
        token.declare(session)
        holders.append(number)
        most[0] = max(most[0], hub.tokens.count(name))
        Ticking(hub).sleep(draw.uniform(0.1, 3.0))
        most[0] = max(most[0], hub.tokens.count(name))
        token.release()

    def stand_by(number):
        session, clock = cast("Any", Link(hub)), Ticking(hub)
        link = WorldLink(KEYS, "robot", print, clock.monotonic)
        monitor = ReconnectMonitor("w", 60.0, str, print, print, clock)
        rejoin = Rejoin("robot", monitor, link, print, print, clock, claims=True)
        for _ in rejoin.stand_by(session):
            hub.turn()
        hold(number, session, rejoin.name)

    def join(number):
        session, token = cast("Any", Link(hub)), NameToken("robot", KEYS, claims=True)
        Ticking(hub).sleep(STANDBY_SECONDS + draw.uniform(-0.5, 0.5))
        for _ in token.until_free(session, lambda: hub.now, NAME_FREE_AGAIN):
            hub.turn()
        hold(number, session, token)

    acts = [lambda n=n: stand_by(n) for n in range(standbys)] + [lambda: join("joins")]
    for thread in [hub.begin(act) for act in acts]:
        thread.join(patience(60))
        assert not thread.is_alive()
    assert most[0] == 1
    assert set(range(standbys)) <= set(holders)
    assert hub.tokens == [KEYS.alive(COORDINATOR)]
