"""Members, strangers and operators that request excessive work: the frames continue."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgpack
import pytest
from running import World, eventually, put, write_world
from zenoh import ZBytes

from minerva_bus import Agent, Context, Event, on
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import Events, single
from minerva_bus.grammar.vocabulary import EventType, Primitive, Vocabulary
from minerva_bus.runtime import receiver as postponing
from minerva_bus.runtime.questions import PAUSE_FACTOR, Answers
from minerva_bus.runtime.receiver import (
    LargeMessages,
    Postponed,
    Receiver,
    WaitingMessage,
)
from minerva_bus.runtime.session import open_client
from minerva_bus.wire.codec import Decoder, encode, stamp
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.plain import DEFAULT, pack, unpack
from minerva_bus.world.services import Participation, When
from tests.patience import patience

FREELY = When(Participation.FREELY)

PStone, eDrop = Primitive("PStone"), EventType("eDrop", number=int)
VOCABULARY = Vocabulary.of(PStone, eDrop)


# --- limits on events per frame ---


def rain():
    world = FrameAlgorithm(WorldSpec("w", PStone(), VOCABULARY))
    world.inbox.work.most_of_generator = 3
    world.receive(s.Appeared("rain"))
    world.receive(m.Hello("rain", PROTOCOL_VERSION, generates=("eDrop",), when=FREELY))
    return world


def frame(world) -> tuple[list[int], Any]:
    done = [message for message in world.receive(s.Begin()) if isinstance(message, s.FrameDone)]
    return [event.number for event in single(done[0].record.events)], done[0].inputs


def test_excess_events_wait_for_the_next_frame_in_order():
    world = rain()
    for number in range(8):
        world.receive(m.Emitted("rain", (eDrop(number),)))
    assert frame(world)[0] == [0, 1, 2]
    world.receive(m.Emitted("rain", (eDrop(8),)))
    assert [frame(world)[0] for _ in range(3)] == [[3, 4, 5], [6, 7, 8], []]


def test_a_journal_has_what_was_taken_and_what_waits():
    world = rain()
    world.receive(m.Emitted("rain", tuple(map(eDrop, range(5)))))
    _, inputs = frame(world)
    assert [len(inputs.taken["rain"]), len(inputs.waiting["rain"])] == [3, 2]
    again = FrameAlgorithm(WorldSpec("w", PStone(), VOCABULARY))
    again.receive(s.Begin(inputs=inputs))
    again.receive(s.Appeared("rain"))
    again.receive(m.Hello("rain", PROTOCOL_VERSION, generates=("eDrop",), when=FREELY))
    assert frame(again)[0] == [3, 4]


def test_events_in_columns_are_taken_whole():
    world = rain()
    world.receive(m.Emitted("rain", (Events.repeated(eDrop(1), 10), eDrop(2))))
    (done,) = [message for message in world.receive(s.Begin()) if isinstance(message, s.FrameDone)]
    assert [event.number for event in single(done.record.events)] == [1, 2]


def test_a_repeated_hello_counts_once():
    world = rain()
    for _ in range(5):
        world.receive(m.Hello("rain", PROTOCOL_VERSION, generates=("eDrop",), when=FREELY))
    assert world.members.get("rain").joins == 1


# --- replies of hosts ---


class Crab(Agent, symbol="ACrab"):
    """An agent that reacts to a drop."""

    wet: int = 0

    @on("eDrop")
    def fall(self, drop: Event, moment: Context) -> None:
        self.wet += drop.number


BEACH = Vocabulary.of(eDrop, Crab)


def asked_host(agents, limits):
    """A receiver whose frame waits for a host, and what it hands to the frame."""
    string = BEACH.read(" · ".join(f"ACrab#a{n}" for n in range(agents)))
    algorithm = FrameAlgorithm(WorldSpec("w", string, BEACH))
    for name, hello in (
        ("rain", {"generates": ("eDrop",), "when": FREELY}),
        ("host", {"kinds": (Crab.kind,)}),
    ):
        algorithm.receive(s.Appeared(name))
        algorithm.receive(m.Hello(name, PROTOCOL_VERSION, **hello))
    algorithm.receive(m.Emitted("rain", (eDrop(1),)))
    algorithm.receive(s.Begin())
    assert algorithm.awaits("host")
    handled, system = [], Still()
    coordinator = SimpleNamespace(
        algorithm=algorithm, system=system, runner=SimpleNamespace(handle=handled.append),
        transport=SimpleNamespace(stamp=b"", empty_reply=b"", evolving_since=0.0), log=None,
        admission=SimpleNamespace(
            keeps_out=lambda member: False,
            rules=SimpleNamespace(has_room=lambda *_: True, objection=lambda hello: ""),
        ),
        metrics=SimpleNamespace(on=False, timed=lambda _, call, *args: call(*args)),
        inbox=SimpleNamespace(put=None, again=None),
    )  # fmt: skip
    return Receiver(cast(Any, coordinator), limits, lambda member: None), handled


@pytest.mark.parametrize("reported", [20, 300])
def test_a_host_may_report_values_up_to_the_limit(reported):
    receiver, handled = asked_host(40, replace(DEFAULT, answer_values=200))
    (part,) = receiver._algorithm.placement.fragments_of("host")
    crabs = [["ACrab", f"a{n}", [1], 0] for n in range(reported)]
    receiver.receive(("host", pack(["evolved", 0, 0, {part: [reported, *crabs]}, {}, {}])))
    (result,) = handled
    if reported == 20:
        assert isinstance(result, m.EvolveReply)
    else:
        assert result.reason.startswith("evolved has at least 201 values, over 200;")
        assert result.reason.endswith("or raise answer_values in [limits]")


@pytest.mark.parametrize(
    ("number", "size", "aside"), [(1, 200_000, 0), (1, 300_000, 1), (2_000, 20, 1), (2_000, 2, 0)]
)
def test_only_messages_that_take_long_are_decoded_in_a_thread(number, size, aside):
    receiver, handled = asked_host(1, DEFAULT)
    body = pack(["evolved", 0, 0, {}, {}, {}, [b"x" * size] * number])
    receiver.receive(("host", body))
    assert len(receiver._large._system.calls) == aside
    assert len(handled) == 1 - aside  # A violation, since no host sends these bytes.


# --- large messages and questions, with a simulated clock ---


class Still:
    """A system in which nothing happens by itself."""

    def __init__(self):
        self.now, self.calls = 0.0, []

    def monotonic(self):
        return self.now

    def aside(self, call):
        self.calls.append(call)


def letters(system, put):
    return LargeMessages(Decoder(VOCABULARY), system, put)


def test_large_messages_are_opened_one_at_a_time_and_members_take_turns():
    system, opened = Still(), []
    large = letters(system, opened.append)
    for member, number in (("a", 1), ("a", 2), ("b", 3)):
        large.add(WaitingMessage(member, 1, encode(m.Emitted(member, (eDrop(number),)))))
    order = []
    while system.calls:
        assert len(system.calls) == 1
        system.calls.pop()()
        large.taken(opened[-1])
        order.append((opened[-1].large.member, opened[-1].message.events[0].number))
    assert order == [("a", 1), ("b", 3), ("a", 2)]
    assert [large.behind(member) for member in "ab"] == [0, 0]


def test_a_large_message_that_is_wrong_is_handed_over_with_what_is_wrong():
    system, opened = Still(), []
    large = letters(system, opened.append)
    large.add(WaitingMessage("a", 1, b"\xc1"))
    system.calls.pop()()
    assert opened[0].message is None
    assert "this is not msgpack" in opened[0].problem


# --- postponed messages ---


def slow_work(system, done, seconds=0.004):
    def process(message):
        system.now += seconds
        done.append(message.data)

    return Postponed(process, system.monotonic)


def test_a_burst_is_processed_for_some_time_and_the_rest_in_order_later():
    system, done = Still(), []
    postponed = slow_work(system, done)
    for number in range(10):
        assert postponed.add(WaitingMessage("a", 1, b"%d" % number))
    assert done == [b"0", b"1", b"2", b"3"]
    postponed.process_next()
    assert done[-1] == b"4"
    # Time passes in which replies arrive.
    system.now += 0.1
    assert postponed.add(WaitingMessage("b", 1, b"last"))
    while postponed.queue:
        postponed.process_next()
    assert done == [*[b"%d" % number for number in range(10)], b"last"]


def test_postponed_messages_are_limited_in_number_and_bytes(monkeypatch):
    monkeypatch.setattr(postponing, "MOST", 5)
    monkeypatch.setattr(postponing, "MOST_BYTES", 20)
    system, done = Still(), []
    postponed = slow_work(system, done, seconds=1.0)
    taken = [postponed.add(WaitingMessage("a", 1, b"1234")) for _ in range(9)]
    assert taken == [True] * 6 + [False] * 3
    while postponed.queue:
        postponed.process_next()
    # One message is never too large here, so that the decoder can name what is wrong with it.
    assert postponed.add(WaitingMessage("a", 1, b"x" * 100))
    assert not postponed.add(WaitingMessage("a", 1, b"x"))


class Query:
    """A query as Zenoh delivers it, which keeps its replies."""

    key_expr = "minerva/w/control"
    payload = ZBytes(pack({"ask": "slow"}))
    attachment = None

    def __init__(self, replies):
        self.reply = lambda key, data: replies.append(unpack(data))

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


def test_excess_questions_are_rejected_at_once_and_answers_leave_time_for_frames():
    system, answered, replies = Still(), [], []

    def slow(_world, asked):
        system.now += 1.0
        answered.append(asked)
        return {}

    algorithm = SimpleNamespace(world=SimpleNamespace(name="w"))
    world: Any = SimpleNamespace(algorithm=algorithm, system=system, commands={"slow": slow})
    admission: Any = SimpleNamespace(objection_to_question=lambda *_: "")
    limits = replace(DEFAULT, questions=3)
    answers = Answers(world, admission, limits, lambda: None)

    def ask():
        query: Any = Query(replies)
        question = answers.admit(query)
        if question is not None:
            answers.add(question)

    for _ in range(5):
        ask()
    assert [reply["error"] for reply in replies] == [
        "3 questions wait for an answer already; ask again in a moment"
    ] * 2
    answers.answer_due()
    answers.answer_due()
    assert len(answered) == 1
    assert answers.wait == PAUSE_FACTOR
    ask()
    assert replies[2:] == [{}]  # The query was admitted: the only new reply is the first answer.
    system.now += 2 * PAUSE_FACTOR
    assert answers.wait == 0
    answers.answer_due()
    assert len(answered) == 2


# --- over the bus ---

FIGURES = pack(["doing", {str(n): n for n in range(200_000)}])
TOO_MUCH = {
    "many events": (
        lambda: pack(["emitted", [["eSeen", [n], "", "", [f"a{n}"]] for n in range(150_000)]]),
        "emitted has at least 50001 values, over 50000; send many events or agents in columns,"
        " which are few values, or raise values in [limits]",
    ),
    "single events": (
        lambda: pack(["emitted", [["eSeen", [n]] for n in range(DEFAULT.single_events + 1)]]),
        "emitted has 2001 single events, over 2000; send those of one type in columns",
    ),
    "figures": (
        lambda: FIGURES, f"doing has {len(FIGURES)} bytes, over 262144"
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = write_world(tmp_path_factory.mktemp("work"), frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        yield world


def goes_on(world):
    before = eventually(lambda: world.members() and world.frame, "it answers")
    eventually(lambda: world.members() and world.frame > before + 3, "the world goes on")


def joined(session, world, name, **faces):
    """Join with raw messages; returns the epoch, the received messages and the open handles."""
    keys, heard = Keys(world.name), []
    (reply,) = session.liveliness().get(keys.epoch("*"))
    epoch = stamp(int(str(cast("Any", reply).ok.key_expr).rpartition("/")[2]))
    kept = session.declare_subscriber(
        keys.to(name), lambda sample: heard.append(unpack(sample.payload.to_bytes()[len(epoch) :]))
    )
    token = session.liveliness().declare_token(keys.alive(name))
    eventually(lambda: heard, "it is greeted")
    put(session, keys.sent_by(name), epoch + encode(m.Hello(name, PROTOCOL_VERSION, **faces)))
    eventually(lambda: any(message[0] == "welcome" for message in heard), "it is welcome")
    return epoch, heard, (kept, token)


@pytest.mark.parametrize("what", TOO_MUCH)
def test_a_flooding_member_is_removed_and_frames_continue(world, what):
    message, problem = TOO_MUCH[what]
    name = what.replace(" ", "-")
    with open_client(name, world.endpoint()) as session:
        epoch, heard, kept = joined(session, world, name, generates=("eSeen",), when=FREELY)
        put(session, Keys(world.name).sent_by(name), epoch + message())
        refused = eventually(
            lambda: [message for message in heard if message[0] == "refused"], "an answer"
        )
        assert refused == [["refused", problem]]
        assert kept
    world.says(f"{name} │ broke the protocol: {problem[:30]}")
    goes_on(world)


def test_a_viewer_with_very_many_kinds_may_not_join(world):
    kinds = [[f"AX{n}", [], [], [], []] for n in range(200_000)]
    with open_client("viewer", world.endpoint()) as session:
        keys, heard = Keys(world.name), []
        (reply,) = session.liveliness().get(keys.epoch("*"))
        epoch = stamp(int(str(cast("Any", reply).ok.key_expr).rpartition("/")[2]))
        kept = session.declare_subscriber(
            keys.to("viewer"),
            lambda sample: heard.append(unpack(sample.payload.to_bytes()[len(epoch) :])),
        )
        token = session.liveliness().declare_token(keys.alive("viewer"))
        eventually(lambda: heard, "it is greeted")
        hello = msgpack.unpackb(encode(m.Hello("viewer", PROTOCOL_VERSION, draws=("eShow",))))
        hello[1]["kinds"] = kinds
        put(session, keys.sent_by("viewer"), epoch + pack(hello))

        def answers():
            # A member that takes long is greeted again.
            return [message for message in heard if message[0] != "greet"]

        eventually(answers, "it is answered")
        assert answers()[0][0] == "refused"
        assert "hello has" in answers()[0][1]
        assert kept
        token.undeclare()


def test_floods_of_hellos_and_questions_leave_the_frames_going(world):
    keys = Keys(world.name)
    with open_client("flood", world.endpoint()) as session:
        epoch, _, kept = joined(session, world, "flood", generates=("eSeen",), when=FREELY)
        out = session.declare_publisher(keys.sent_by("flood"))
        hello, asked = epoch + encode(m.Hello("flood", PROTOCOL_VERSION)), pack({"ask": "status"})
        replies = []
        for _ in range(300):
            for _ in range(50):
                out.put(hello)
            session.get(keys.control, replies.append, payload=asked, timeout=patience(30))
        goes_on(world)
        eventually(lambda: replies, "questions are answered")
        assert kept
    world.says("flood │ sends more than 5000 messages, 20 hellos", "the rest is dropped")
