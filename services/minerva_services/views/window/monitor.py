"""A thread that polls a world's status and performs actions, so that windows never block."""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import Operator, WorldStatus
from minerva_services.views.fates import LatestOrders, OrderEntry
from minerva_services.views.reports import LatestReport
from minerva_services.views.window.actions import WorldAction

POLL_SECONDS = 0.25
NOTICE_SECONDS = 5.0
MAX_ORDERS = 3
"""Orders that a window lists."""

_CLOSE_SECONDS = 2.0


class WorldMonitor:
    """Polls the world's status every quarter of a second, and performs queued actions in order.

    `status` is the latest, None before the first; `notice` reports the last action or its failure
    for a few seconds.
    """

    def __init__(
        self, operator: Operator, vocabulary: Vocabulary, every: float = POLL_SECONDS
    ) -> None:
        self.status: WorldStatus | None = None
        self._reports = LatestReport(vocabulary)
        self._orders = LatestOrders(MAX_ORDERS)
        self._operator = operator
        self._every = every
        self._queue: SimpleQueue[WorldAction | None] = SimpleQueue()
        # Each counter is written by one thread only, so neither needs a lock.
        self._given, self._done = 0, 0
        self._notice, self._noticed = "", 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        self._thread.start()

    @property
    def notice(self) -> str:
        """Report of the last action, while it is recent."""
        return self._notice if time.monotonic() < self._noticed + NOTICE_SECONDS else ""

    @property
    def report(self) -> str:
        """The latest report of an agent, such as that it has reached its objective."""
        return self._reports.text

    @property
    def orders(self) -> tuple[OrderEntry, ...]:
        """The last orders of all people, with their fates."""
        return self._orders.entries

    @property
    def busy(self) -> bool:
        """True while actions are queued: the status may predate them."""
        return self._given != self._done

    def do(self, action: WorldAction | None) -> None:
        """Queue an action; None is ignored."""
        if action is not None:
            self._given += 1
            self._queue.put(action)

    def notify(self, text: str) -> None:
        """Show a line for a few seconds."""
        self._noticed, self._notice = time.monotonic(), text

    def close(self) -> None:
        """Stop polling."""
        self._over.set()
        self._queue.put(None)
        self._thread.join(_CLOSE_SECONDS)

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                action = self._queue.get(timeout=self._every)
            except Empty:
                action = None
            if self._over.is_set():
                return
            self._try(action)
            self._done += action is not None

    def _try(self, action: WorldAction | None) -> None:
        try:
            if action is not None:
                self.notify(action.do(self._operator))
            self.status = status = self._operator.status(self._reports.last)
            self._reports.update(status)
            self._orders.update(self._operator)
        except MisuseError as error:  # the world has no operator: report it once
            self.notify(str(error))
            if action is None:
                self._over.set()
        except MinervaError as error:
            self.notify(str(error).partition("\n")[0])
        except Exception:
            if not self._over.is_set():  # a closing session raises many types
                raise
