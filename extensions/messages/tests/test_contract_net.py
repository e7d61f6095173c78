"""A complete world with a contract net of one hundred bidders."""

from extensions.messages.tests.auction import auction
from minerva_bus.grammar.scene import agents


def state(string, who):
    return next(dict(agent.state) for agent in agents(string) if agent.id == who)


def test_it_ends_by_its_deadline_although_one_never_answers():
    strings, _ = auction()
    seller = state(strings[-1], "s")
    assert seller["awarded"] == 1 + 5 + 1
    assert seller["silent"] == 2
    assert seller["ended"] == "done"
    assert seller["talks"] == type(strings[0])()


def test_the_cheapest_wins_and_all_others_are_notified():
    strings, messages = auction()
    seller = state(strings[-1], "s")
    prices = {
        event.sender: float(event.content)
        for frame, event in messages
        if event.performative == "propose" and frame <= 7
    }
    assert len(prices) == 98
    assert seller["winner"] == min(prices, key=lambda who: (prices[who], who))
    lost = [
        agent for agent in agents(strings[-1]) if agent.symbol == "ABidder" and agent.state["lost"]
    ]
    assert len(lost) == 98  # All but the winner and the silent bidder; includes the late one.


def test_a_late_bid_is_rejected_as_such():
    _, messages = auction()
    (late,) = [
        event
        for _, event in messages
        if event.performative == "reject-proposal" and event.content == "too late"
    ]
    assert late.receivers == ("b1",)


def test_only_the_silent_agent_still_holds_the_call():
    strings, _ = auction()
    holding = [agent.id for agent in agents(strings[-1]) if agent.state["talks"]]
    assert holding == ["b0"]


def test_the_same_string_on_one_host_and_on_three():
    single, three = auction(1), auction(3)
    assert [w.digest for w in single[0]] == [w.digest for w in three[0]]


def test_another_seed_has_another_winner():
    assert state(auction(1, 6)[0][-1], "s")["price"] != state(auction()[0][-1], "s")["price"]
