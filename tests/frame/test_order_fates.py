"""The fates of people's orders: taken by a frame, and reported by agents."""

from minerva_bus import EventType, Vocabulary
from minerva_bus.runtime.metrics import MAX_ORDERS, OrderFates
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_bus.world.event_collection import Priority

eFetch = EventType("eFetch", what=str)
eStay = EventType("eStay")
eFetched = EventType("eFetched", completes=eFetch, what=str)
eLost = EventType("eLost", fails=["eFetch"], what=str, why=str)
eSit = EventType("eSit", replaces=("eSit", eFetch), where=str)
VOCABULARY = Vocabulary.of(eFetched, eLost, eFetch, eStay, eSit)


def given(*orders, frame=1):
    """Orders of Anna that all count in a frame."""
    fates = OrderFates(VOCABULARY)
    for order in orders:
        fates.arrive(order, "anna", frame - 1)
        fates.judge(order, "anna", frame)
    return fates


def states(fates):
    return [order.state for order in sorted(fates.changed_since(0), key=lambda each: each.number)]


def test_an_order_waits_until_a_frame_takes_it_or_a_norm_rejects_it():
    fates = OrderFates(VOCABULARY)
    for person in ("anna", "bert"):
        fates.arrive(eStay(), person, 3)
    assert states(fates) == ["waiting", "waiting"]
    fates.judge(eStay(), "bert", 4, "rejected", "curfew")
    fates.judge(eStay(), "anna", 4)
    fates.end_frame(4, ())
    assert states(fates) == ["accepted", "rejected"]
    anna, bert = sorted(fates.changed_since(0), key=lambda order: order.number)
    assert (anna.fate, bert.fate) == (
        "accepted in frame 4",
        "rejected by the norm curfew in frame 4",
    )
    assert not anna.open
    assert not bert.open
    assert [order.person for order in fates.changed_since(bert.change)] == ["anna"]


def test_an_order_is_open_until_its_frame_ends_which_may_drop_it():
    fates = given(eSit("here"), eStay(), eSit("there"), frame=4)
    assert all(order.open for order in fates.changed_since(0))
    fates.judge(eStay(), "anna", 4, "dropped", "host")
    fates.judge(eSit("there"), "anna", 4, "dropped", "host")
    assert not fates.end_frame(4, ())
    assert states(fates) == ["accepted", "dropped", "dropped"]
    (fate, *_) = {order.fate for order in fates.changed_since(0) if order.state == "dropped"}
    assert fate == "dropped because host ended twice in frame 4"
    assert [order.open for order in fates.changed_since(0) if order.state == "dropped"] == [
        False
    ] * 2


def test_a_report_concerns_the_last_order_to_its_sender_with_equal_data_and_all_equal_ones():
    ball, stick = eFetch("ball", receivers=["rex"]), eFetch("stick", receivers=["rex"])
    fates = given(ball, eFetch("ball", receivers=["ace"]), stick, ball, eStay())
    assert fates.end_frame(1, [eFetched("ball", sender="rex")]) == [], "of an earlier order"
    assert fates.end_frame(2, [eFetched("ball"), eFetched("ball", sender="max")]) == []
    fates.end_frame(2, [eFetched("ball", sender="rex"), eLost("stick", "eaten", sender="rex")])
    assert states(fates) == ["done", "accepted", "failed", "done", "accepted"]
    failed = next(order for order in fates.changed_since(0) if order.state == "failed")
    assert failed.fate == (
        'failed, reported by eLost<what="stick", why="eaten"> from #rex, in frame 2'
    )
    assert fates.end_frame(3, [eFetched("stick", sender="rex")]) == [], "it has ended"


def test_an_order_to_all_that_one_agent_gives_up_may_still_be_done():
    fates = given(eFetch("ball"))
    (failed,) = fates.end_frame(2, [eLost("ball", "far", sender="ace")])
    assert (failed.state, failed.open) == ("failed", True)
    (done,) = fates.end_frame(3, [eFetched("ball", sender="rex")])
    assert (done.state, done.by, done.open) == ("done", "rex", False)


def test_an_order_that_all_its_agents_drop_for_another_is_replaced():
    fates = given(eSit("here", receivers=["rex"]))
    fates.end_frame(1, [])
    fates.judge(eSit("there", condition="x > 0"), "bert", 2)
    fates.judge(eSit("here", receivers=["rex"]), "bert", 2)
    assert fates.end_frame(2, []) == [], "only its agents know the condition; the other is equal"
    fates.judge(eSit("there", receivers=["rex"]), "bert", 3)
    both = fates.end_frame(3, [])
    assert [order.number for order in both] == [1, 3]
    assert not both[0].open
    assert both[0].fate == 'replaced by eSit<where="there"> to #rex in frame 3'
    fates = given(eFetch("ball"), eFetch("stick", receivers=["rex", "ace"]))
    fates.judge(eSit("there", receivers=["rex"]), "bert", 2)
    assert fates.end_frame(2, []) == [], "other agents may carry them out"
    fates.judge(eSit("here"), "bert", 3)
    assert [order.number for order in fates.end_frame(3, [])] == [1, 2, 3]


def test_orders_of_one_frame_replace_each_other_as_agents_receive_them():
    # By type, then by person, although the orders are judged person by person.
    fates = OrderFates(VOCABULARY, Priority(("eSit", "eFetch")))
    fates.judge(eFetch("ball"), "anna", 1)
    fates.judge(eSit("here"), "anna", 1)
    fates.judge(eSit("there"), "bert", 1)
    fates.end_frame(1, [])
    assert states(fates) == ["accepted", "replaced", "accepted"]


def test_the_last_orders_are_kept():
    fates = given(*[eFetch(str(number)) for number in range(MAX_ORDERS + 5)])
    assert len(fates.changed_since(0)) == MAX_ORDERS
    assert fates.end_frame(2, [eFetched("4", sender="rex")]) == []
    assert len(fates.end_frame(2, [eFetched("5", sender="rex")])) == 1


def test_reports_survive_the_wire_and_are_absent_without_any():
    plain = plain_vocabulary(VOCABULARY)
    assert plain["completes"] == {"eFetched": ["eFetch"]}
    back = read_vocabulary(plain).events
    assert (back["eFetched"].completes, back["eLost"].fails) == (("eFetch",), ("eFetch",))
    assert back["eSit"].replaces == ("eSit", "eFetch")
    assert not {"completes", "fails", "replaces"} & plain_vocabulary(Vocabulary.of(eStay)).keys()


def test_an_order_to_all_has_failed_when_all_that_it_is_for_have_failed_it():
    fates = OrderFates(VOCABULARY)
    fates.arrive(eFetch("tea"), "anna", 0, able=2)
    fates.judge(eFetch("tea"), "anna", 1)
    fates.end_frame(1, ())
    for frame, agent, is_open in ((2, "a", True), (3, "a", True), (4, "b", False)):
        (order,) = fates.end_frame(frame, [eLost("tea", "gone", sender=agent)])
        assert (order.state, order.open) == ("failed", is_open)
