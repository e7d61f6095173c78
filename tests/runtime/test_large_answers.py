"""Large answers wait for the thread that decodes them, a few of each member."""

from types import SimpleNamespace
from typing import Any

import pytest

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.vocabulary import EventType, Primitive, Vocabulary
from minerva_bus.runtime.receiver import IN_COLUMNS, MAX_BEHIND, Receiver
from minerva_bus.runtime.session import REAL
from minerva_bus.wire.plain import DEFAULT, pack
from minerva_bus.world.services import Participation, When

PStone, eDrop = Primitive("PStone"), EventType("eDrop")


def receiver_of(algorithm: FrameAlgorithm, put: Any) -> Receiver:
    rules = SimpleNamespace(has_room=lambda *_: True, objection=lambda hello: "")
    coordinator: Any = SimpleNamespace(
        algorithm=algorithm, system=REAL, runner=SimpleNamespace(handle=None), log=print,
        transport=SimpleNamespace(stamp=b"", empty_reply=b"", evolving_since=0.0),
        admission=SimpleNamespace(keeps_out=lambda member: False, rules=rules),
        metrics=SimpleNamespace(on=False), inbox=SimpleNamespace(put=put, again=None),
    )  # fmt: skip
    return Receiver(coordinator, DEFAULT, lambda member: None)


def test_only_a_few_large_answers_of_a_member_wait(monkeypatch: pytest.MonkeyPatch):
    algorithm = FrameAlgorithm(WorldSpec("w", PStone(), Vocabulary.of(PStone, eDrop)))
    algorithm.receive(s.Appeared("sonar"))
    hello = m.Hello(
        "sonar", PROTOCOL_VERSION, generates=("eDrop",), when=When(Participation.IN_STEP)
    )
    algorithm.receive(hello)
    algorithm.receive(s.Begin())
    assert algorithm.awaits("sonar")
    receiver, waiting, dropped = receiver_of(algorithm, None), list[Any](), list[str]()
    large = SimpleNamespace(add=waiting.append, behind=lambda member: len(waiting))
    monkeypatch.setattr(receiver, "_large", large)
    monkeypatch.setattr(receiver, "_drop", dropped.append)
    report = pack(["ticked", 0, [], {"map": b"0" * 2 * IN_COLUMNS}])
    for _ in range(MAX_BEHIND + 2):
        receiver.receive(("sonar", report))
    assert len(waiting) == MAX_BEHIND
    assert dropped == ["sonar"] * 2
