"""A host uses the fields of its own classes for a vocabulary that it has received."""

import pytest

from minerva_bus import Agent, EventType, Vocabulary, on
from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member
from minerva_bus.grammar.fields import Fields
from minerva_bus.wire.codec import Decoder, encode

eStep = EventType("eStep")


class Snail(Agent, symbol="ASnail"):
    way: tuple[float, ...] = ()
    steps: int = 0

    @on("eStep")
    def step(self, event, moment):
        self.steps += 1


class Slug(Agent, symbol="ASlug"):
    steps: int = 0

    @on("eStep")
    def step(self, event, moment):
        self.steps += 1


def welcomed(vocabulary):
    """A host of snails that has received a vocabulary as bytes."""
    welcome = m.Welcome("garden", vocabulary, seed=1, dt=0.1, frame=0)
    host = Member("snails", agents=[Snail])
    host.receive(Decoder().to_member(encode(welcome)))
    return host


def fields_of(host, symbol):
    assert host.world is not None
    return host.world.vocabulary.fields(symbol)


def test_equal_fields_are_those_of_the_class():
    host = welcomed(Vocabulary.of(Snail, Slug, eStep))
    assert fields_of(host, "ASnail") is Snail.kind.fields
    slug = fields_of(host, "ASlug")
    assert slug == Slug.kind.fields
    assert slug is not Slug.kind.fields


def test_other_fields_are_those_of_the_world():
    class Other(Agent, symbol="ASnail"):
        way: tuple[float, ...] = ()
        steps: int = 7

    host = welcomed(Vocabulary.of(Other, eStep))
    assert fields_of(host, "ASnail") == Other.kind.fields
    assert fields_of(host, "ASnail") != Snail.kind.fields


def test_values_are_fitted_once_in_a_frame(monkeypatch: pytest.MonkeyPatch):
    host = welcomed(Vocabulary.of(Snail, eStep))
    host.receive(m.Fragments({"s1": Snail("s1", way=(1.0, 2.0)).string}, ()))

    def step(frame):
        return host.receive(m.EvolveRequest(frame, ("snails",), (eStep(),)))

    step(0)  # After it, the host has what its own agents have become.
    refitted = []
    refit = Fields.refit

    def counted(self, owner, names, values):
        refitted.append(owner)
        return refit(self, owner, names, values)

    monkeypatch.setattr(Fields, "refit", counted)
    (reply,) = step(1)
    assert reply.changed["s1"].nodes[0].state["steps"] == 2
    assert refitted == []
