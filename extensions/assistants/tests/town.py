"""A town whose agents send requests to a mind, for tests in processes."""

from __future__ import annotations

from typing import Literal

from minerva_assistants.minds import MINDS, eAsk
from minerva_bus import EMPTY, Agent, EventType, Vocabulary, on

eStep = EventType("eStep")
eChoice = EventType("eChoice", action=Literal["eat", "sleep"], amount=int)
eHappy = EventType("eHappy")


class Person(Agent, symbol="APerson"):
    """Asks again and again; is happy after `wanted` answers or failures."""

    wanted: int = 2
    within: float = 1000.0
    steps: int = 0
    asking: bool = False
    fate: tuple[str, ...] = ()

    @on("eStep")
    def live(self, step, moment):
        self.steps += 1
        if not self.asking and len(self.fate) < self.wanted:
            self.asking = True
            prompt = f"I am {self.id} at {self.steps}"
            moment.emit(eAsk(prompt, "", "eChoice", "", self.within, receivers=["mind"]))

    @on("eChoice")
    def choose(self, choice, moment):
        self.end(f"{choice.action} {choice.amount}", moment)

    @on("eNoAnswer")
    def fail(self, failure, moment):
        self.end(failure.reason, moment)

    def end(self, how, moment):
        self.asking = False
        self.fate += (how,)
        if len(self.fate) == self.wanted:
            moment.emit(eHappy())


class Mortal(Agent, symbol="AMortal"):
    """Asks once, and is gone ten frames later."""

    age: int = 0

    @on("eStep")
    def live(self, step, moment):
        if self.age == 0:
            moment.emit(eAsk(f"I am {self.id}", receivers=["mind"]))
        self.age += 1
        return EMPTY if self.age > 10 else None


vocabulary = Vocabulary.of(*MINDS, eStep, eChoice, eHappy, Person, Mortal)

RULES = [
    {
        "when": "I am (?P<who>[a-z]+) at (?P<n>[0-9]+)",
        "answer": [{"action": "dance", "amount": 0}, {"action": "eat", "amount": 2}],
        "seconds": 0.4,
        "tokens": [50, 5],
    }
]


def decide(prompt):
    """A function that answers at once."""
    return {"action": "sleep", "amount": len(prompt.request.asker)}
