"""A thread that asks a world how it is doing and does deeds, so that no window waits for it."""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.world.operator import Operator, WorldStatus
from minerva_services.views.window.deeds import Deed

EVERY = 0.25
SHOWN_FOR = 5.0
_CLOSED_WITHIN = 2.0


class Watch:
    """The world's status, asked for every quarter of a second, and one deed after another.

    `status` is the newest, None before the first; `notice` what was done last, or why it could not
    be, for some seconds.
    """

    def __init__(self, operator: Operator, every: float = EVERY) -> None:
        self.status: WorldStatus | None = None
        self._operator = operator
        self._every = every
        self._deeds: SimpleQueue[Deed | None] = SimpleQueue()
        self._given, self._done = 0, 0
        self._notice, self._noticed = "", 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)
        self._thread.start()

    @property
    def notice(self) -> str:
        """What was done last, while it is new."""
        return self._notice if time.monotonic() < self._noticed + SHOWN_FOR else ""

    @property
    def busy(self) -> bool:
        """Whether deeds are still to be done: the status may be from before them."""
        return self._given != self._done

    def do(self, deed: Deed | None) -> None:
        """Let a deed be done soon; None: nothing."""
        if deed is not None:
            self._given += 1
            self._deeds.put(deed)

    def tell(self, text: str) -> None:
        """Show a line for some seconds."""
        self._noticed, self._notice = time.monotonic(), text

    def close(self) -> None:
        """Ask no more."""
        self._over.set()
        self._deeds.put(None)
        self._thread.join(_CLOSED_WITHIN)

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                deed = self._deeds.get(timeout=self._every)
            except Empty:
                deed = None
            if self._over.is_set():
                return
            self._try(deed)
            self._done += deed is not None

    def _try(self, deed: Deed | None) -> None:
        try:
            if deed is not None:
                self.tell(deed.do(self._operator))
            self.status = self._operator.status()
        except MisuseError as error:  # such a world has no operator: once is enough
            self.tell(str(error))
            if deed is None:
                self._over.set()
        except MinervaError as error:
            self.tell(str(error).partition("\n")[0])
        except Exception:
            if not self._over.is_set():  # a session that is being closed fails in many ways
                raise
