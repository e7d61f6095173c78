"""A coordinator that breaks one rule fails the cases about this rule, and no others.

The coordinator of Minerva Bus is genuine; messages from it and to it are altered on the way, so that
it looks to the members of the suite like one that breaks the rule.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import pytest

from minerva_bus.wire.codec import stamp, stamped
from minerva_bus.wire.plain import pack, unpack
from minerva_conformance import coordinating
from minerva_conformance.case import CaseOutcome
from minerva_conformance.cases.coordinated import COORDINATED
from minerva_conformance.coordinating import Stage, play_on
from minerva_conformance.launching import command
from minerva_conformance.scripted_member import ScriptedMember

OWN = [sys.executable, "-m", "minerva_conformance.coordinator"]
ANSWER_SECONDS = 5.0

Message = list
Alteration = Callable[[Message], Message | None]


def unaltered(message: Message) -> Message:
    return message


@dataclass(frozen=True)
class Mutant:
    """A broken coordinator: how its messages and those to it are altered; None: lost."""

    name: str
    requirements: str
    received: Alteration = unaltered
    sent: Alteration = unaltered


def in_view(change: Callable[[Message], object]) -> Alteration:
    def altered(message: Message) -> Message:
        if message[0] == "view":
            change(message)
        return message

    return altered


def in_hello(**changed: object) -> Alteration:
    return lambda message: (
        [message[0], {**message[1], **changed}] if message[0] == "hello" else message
    )


def with_views_in_each_frame(message: Message) -> Message:
    if message[0] != "hello":
        return message
    hello: dict[str, object] = message[1]
    when = str(hello["when"]).replace("each 3 frames", "each frame")
    return [message[0], {**hello, "when": when}]


def in_evolved(change: Callable[[Message], Message | None]) -> Alteration:
    return lambda message: change(message) if message[0] == "evolved" else message


def in_patches(change: Callable[[list], list]) -> Alteration:
    def altered(message: Message) -> Message:
        changed = {
            name: change(string) if string[:1] == ["patch"] else string
            for name, string in message[3].items()
        }
        return [*message[:3], changed, *message[4:]]

    return in_evolved(altered)


def without_view_patches(message: Message) -> Message:
    views = {
        event_type: {name: v for name, v in views.items() if v[:1] != ["patch"]}
        for event_type, views in message[5].items()
    }
    return [*message[:5], views]


def without_skeleton(view: Message) -> None:
    view[5] = None


def with_skeleton(view: Message) -> None:
    view[5] = view[5] or [1, ["ACounter", "a", None, 0]]


def with_old_sequence(view: Message) -> None:
    view[3] = 1


def other_digest(message: Message) -> Message:
    return [*message[:-1], bytes(16)] if message[0] == "frame" else message


MUTANTS = (
    Mutant("records another digest", "P12.1", other_digest),
    Mutant("sends no skeleton", "P10.2", in_view(without_skeleton)),
    Mutant("sends key views only", "P10.3", in_view(with_skeleton)),
    Mutant("does not count views", "P10.4", in_view(with_old_sequence)),
    Mutant(
        "ignores a request for a key view",
        "P10.5",
        sent=lambda message: None if message[0] == "resync" else message,
    ),
    Mutant("requests views in every frame", "P7.1", sent=with_views_in_each_frame),
    Mutant("sends columns to every host", "P9.21", sent=in_hello(plain=False)),
    Mutant("drops patches", "P9.10", sent=in_patches(lambda patch: [*patch[:3], []])),
    Mutant("drops patches of views", "P10.3", sent=in_evolved(without_view_patches)),
    Mutant("takes any patch", "P9.11", sent=in_patches(lambda patch: [patch[0], 140, *patch[2:]])),
    Mutant(
        "takes the last of two results",
        "P14.5",
        sent=in_evolved(lambda message: None if b"\x3f\xf8" in pack(message) else message),
    ),
    Mutant(
        "takes results for any part",
        "P7.3",
        sent=in_evolved(lambda message: [*message[:2], message[2] % 5, *message[3:]]),
    ),
    Mutant(
        "ignores fragments of others",
        "P9.5",
        sent=in_evolved(lambda m: [*m[:3], {k: s for k, s in m[3].items() if k != "b"}, *m[4:]]),
    ),
)


class Altered(ScriptedMember):
    """A member whose messages are altered."""

    mutant = MUTANTS[0]

    def put(self, rest: str, data: bytes) -> None:
        epoch, body = stamped(data)
        message = self.mutant.sent(unpack(body))
        if message is not None:
            super().put(rest, stamp(epoch) + pack(message))

    def next(self, until: float):
        sample = super().next(until)
        if sample is None or self.keys.kind(sample.key) in ("alive", "epoch"):
            return sample
        if self.keys.kind(sample.key) == "record":
            return replace(sample, data=pack(self.mutant.received(unpack(sample.data))))
        epoch, body = stamped(sample.data)
        return replace(sample, data=stamp(epoch) + pack(self.mutant.received(unpack(body))))


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("MINERVA_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))
        patched.setattr(coordinating, "ANSWER_SECONDS", ANSWER_SECONDS)
        with Stage(command(OWN)) as stage:
            stage.await_start()
            patched.setattr(coordinating, "ScriptedMember", Altered)
            yield stage


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_broken_rule_is_found_by_the_cases_about_it(mutant: Mutant, stage: Stage) -> None:
    Altered.mutant = mutant
    results = [play_on(stage, script) for script in COORDINATED]
    failed = [result for result in results if result.outcome is CaseOutcome.FAILED]
    assert failed, "no case fails"
    others = [r for r in failed if mutant.requirements not in r.case.requirements]
    assert [(result.case.id, result.problem[:200]) for result in others] == []
