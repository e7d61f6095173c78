"""The thread that requests the status of a world and executes actions."""

import threading
from dataclasses import replace

from window_world import WORDS, Ledger, status

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.operator import OrderStatus
from minerva_services.views.palette import person_colour
from minerva_services.views.window.actions import OrderAction, PauseAction
from minerva_services.views.window.composer import caption
from minerva_services.views.window.monitor import WorldMonitor
from tests.patience import eventually, patience


def test_it_asks_again_and_again():
    ledger = Ledger()
    watch = WorldMonitor(ledger, WORDS, every=0.01)
    eventually(lambda: ledger.asked > 3)
    assert watch.status.orders == ("eGo", "eHaste")
    watch.close()
    asked = ledger.asked
    assert not watch._thread.is_alive()
    assert ledger.asked == asked


def test_it_has_the_last_orders_of_all_people():
    ledger = Ledger()
    ledger.fates = [
        OrderStatus(n, n, "anna" if n % 2 else "", f"eGo<place={n}>", "eGo", "waiting", 3)
        for n in range(1, 7)
    ]
    watch = WorldMonitor(ledger, WORDS, every=0.01)
    assert [order.event for order in eventually(lambda: watch.orders)] == [
        f"eGo<place={n}>" for n in (4, 5, 6)
    ]
    assert (watch.orders[0].person, watch.orders[1].person) == ("somebody", "anna")
    assert watch.orders[1].colour == person_colour("anna")
    ledger.fates.append(replace(ledger.fates[3], change=7, state="done", by="b1", frame=9))
    done = eventually(lambda: watch.orders[-1].state == "done" and watch.orders[-1])
    assert (done.event, done.fate) == ("eGo<place=4>", "done, reported by #b1, in frame 9")
    watch.close()


def test_handlers_run_in_order_and_are_reported():
    ledger = Ledger()
    watch = WorldMonitor(ledger, WORDS, every=60.0)
    watch.do(PauseAction())
    watch.do(None)
    watch.do(OrderAction(WORDS.events["eGo"]("attic")))
    eventually(lambda: len(ledger.told) == 2)
    assert ledger.told == ["pause", 'order eGo<place="attic">']
    assert eventually(lambda: watch.notice) == 'sent eGo<place="attic">'
    watch.close()


def test_it_is_busy_until_the_status_is_from_after_the_deed():
    class Slow(Ledger):
        may = threading.Event()

        def status(self, since=0):
            if self.told:
                assert self.may.wait(patience(20))
            return status(paused=bool(self.told))

    ledger = Slow()
    watch = WorldMonitor(ledger, WORDS, every=0.01)
    eventually(lambda: watch.status)
    assert not watch.busy
    watch.do(PauseAction())
    eventually(lambda: ledger.told)
    assert watch.busy
    assert not watch.status.paused
    ledger.may.set()
    eventually(lambda: not watch.busy)
    assert watch.status.paused
    watch.close()


def test_an_unresponsive_world_is_reported_and_asked_again():
    ledger = Ledger(error="the world has not answered\nfor a second")
    watch = WorldMonitor(ledger, WORDS, every=0.01)
    assert eventually(lambda: watch.notice) == "the world has not answered"
    ledger.error = ""
    eventually(lambda: watch.status)
    watch.close()


def test_a_world_without_an_operator_is_asked_once():
    class Nobody(Ledger):
        def status(self, since=0):
            self.asked += 1
            raise MisuseError("nobody can operate this world from here")

    watch = WorldMonitor(Nobody(), WORDS, every=0.001)
    eventually(lambda: not watch._thread.is_alive())
    assert watch._operator.asked == 1
    watch.close()


def test_a_rejected_order_is_reported():
    watch = WorldMonitor(Ledger(error="nobody takes eGo"), WORDS, every=60.0)
    watch.do(OrderAction(Event("eGo", ("place",), ("x",))))
    assert eventually(lambda: watch.notice) == "nobody takes eGo"
    watch.close()


def test_the_caption():
    assert caption(-1, 0.1, None) == "no view yet"
    assert caption(30, 0.1, None) == "frame 30  ·  3.0 s"
    assert caption(30, 0.1, status(paused=True), "b1") == "frame 30  ·  3.0 s  ·  paused  ·  b1"
    slow = status(rate=30.0, hz=12.2)
    assert caption(30, 0.1, slow).endswith("12 of 30 frames per second")
    assert caption(30, 0.1, status(hz=30.0, rate=30.0)).endswith("·  30 frames per second")
    waiting = status(waiting=("foxes",), waited=2.0)
    assert caption(0, 0.1, waiting).endswith("waiting for foxes")
