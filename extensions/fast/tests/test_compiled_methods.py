"""A compiled method gives the same string, events and errors as the method itself, row by row."""

from __future__ import annotations

import math
import sys
from importlib import import_module
from typing import Literal

import numpy as np
import pytest

pytest.importorskip("numba")

from twins import compiled_form, outcome, same

from minerva_bus import EMPTY, Agent, EventType, on, portable
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.context import Frame

eDay = EventType("eDay", grass=float, name=str, wet=bool, count=int)
eHit = EventType("eHit", amount=float)
eCall = EventType("eCall", loud=float, word=str)
eEgg = EventType("eEgg", size=int)
LIMIT = 8
NAMES = ("a", "b", "c")
WEIGHTS = (1.0, 0.5, 2.0)


def many(cls, count=50, **state):
    return cls.many("a", count, **state)


def day(**data):
    return eDay(**{"grass": 1.0, "name": "x", "wet": True, "count": 3} | data)


def test_numbers_branches_births_and_deaths():
    class Sheep(Agent, symbol="ASheep"):
        x: float = 0.0
        energy: float = 5.0
        births: int = 0

        @on("eDay")
        def live(self, day, moment):
            self.x += moment.chance.normal(0, 0.5)
            self.energy += day.grass * moment.chance.random() - 0.5
            if self.energy < 0:
                return EMPTY
            if self.energy > LIMIT:
                self.energy /= 2
                return self.string + self.child(x=self.x, energy=self.energy)

    energy = np.linspace(0, 8, 200)
    same(Sheep, many(Sheep, 200, energy=energy), [[day(grass=1.2)]] * 6, parts=3)


def test_all_draws():
    class Dice(Agent, symbol="ADice"):
        a: float = 0.0
        b: float = 0.0
        c: int = 0
        d: bool = False
        e: float = 0.0
        f: float = 0.0

        @on("eDay")
        def roll(self, day, moment):
            chance = moment.chance.random()
            self.a = chance + moment.chance.uniform(1, 3)
            self.b = moment.chance.uniform(high=self.a) + moment.chance.uniform()
            self.c = moment.chance.integers(5) + moment.chance.integers(-3, high=9)
            self.d = moment.chance.chance(0.5)
            self.e = moment.chance.exponential(2) + moment.chance.exponential()
            self.f = moment.chance.normal() + moment.chance.normal(deviation=2.5)
            if self.d:
                self.a = moment.chance.random()

    same(Dice, many(Dice), [[day(), day(grass=2.0)]] * 3)


def test_emitted_events_and_their_receivers():
    class Caller(Agent, symbol="ACaller"):
        friend: str = "a1"
        heard: float = 0.0

        @on("eDay")
        def call(self, day, moment):
            for turn in range(day.count):
                if moment.chance.random() < 0.5:
                    moment.emit(eCall(loud=1.5 * turn, word="hi", receivers=[self.friend]))
            moment.emit(eEgg(size=day.count))

        @on("eCall")
        def answer(self, call, moment):
            self.heard += call.loud
            if call.word == "hi":
                self.friend = call.sender
                moment.emit(eCall(0.5, "back", receivers=[call.sender]))
            else:
                moment.emit(eCall(0.25, self.id, receivers=(self.id,)))

    calls = [
        eCall(loud=1.0, word=w, receivers=[f"a{k}"], sender=f"a{k + 1}")
        for k in (3, 3, 3, 4, 20)
        for w in ("hi", "no")
    ]
    same(Caller, many(Caller), [[day()], calls, [*calls, day(count=7)]])


def test_events_with_a_receiver():
    class Parent(Agent, symbol="AParent"):
        left: str = "a1"
        right: str = "a2"
        sum: float = 0.0

        @on("eDay")
        def call(self, day, moment):
            self.sum += day.grass
            if moment.chance.random() < 0.7:
                moment.emit(eCall(self.sum, "x", receivers=[self.left]))
                moment.emit(eCall(self.sum, "x", receivers=[self.right]))
            if self.left == "a9":
                moment.emit(eCall(0.5, self.id, receivers=("elsewhere",)))
            if day.count == 3 and self.right == "":
                moment.emit(eEgg(size=1))

        @on("eCall")
        def answer(self, call, moment):
            self.sum += call.loud
            self.left, self.right = call.sender, self.left
            moment.emit(eCall(self.sum, "back", receivers=[self.left]))

    calls = [eCall(1.0, "hi", receivers=["a3", "a4"], sender="a9") for _ in range(2)]
    same(Parent, many(Parent), [[day(), *calls], [day(count=3)], [*calls, day(grass=2.0)]])


def test_texts_words_and_bools():
    class Person(Agent, symbol="APerson"):
        name: str = "a"
        health: Literal["S", "I", "R"] = "S"
        calm: bool = True
        met: str = ""

        @on("eDay")
        def live(self, day, moment):
            if self.health == "S" and moment.chance.chance(0.3):
                self.health = "I"
            elif self.health in ("I", "R"):
                self.health = "R" if moment.chance.chance(0.5) else "S"
            self.name = NAMES[moment.chance.integers(len(NAMES))]
            self.calm = (not self.calm and day.wet) or day.name != self.name
            self.met = day.name if self.calm else self.met

    same(Person, many(Person), [[day(name=n, wet=w)] for n in "abü" for w in (True, False)])


def helper(x, y=2.0, *, flip=False):
    if flip:
        return y - x
    return portable.sin(x) * y


def wander(chance, width):
    total = 0.0
    for _ in range(3):
        total += chance.uniform(-width, width)
    return total


def test_helpers_loops_lists_and_tuples():
    class Bug(Agent, symbol="ABug"):
        x: float = 0.0
        y: float = 1.0
        n: int = 0
        SPEED = 0.25

        def rate(self, factor):
            return self.SPEED * factor + self.y

        @staticmethod
        def fixed(first, second=0.5):
            return second

        def drawn(self, moment):
            return moment.chance.random() * moment.dt + self.x

        @on("eDay")
        def live(self, day, moment):
            """Docstrings are skipped."""
            counts = [0] * 4
            parts = [1.0, self.x, 2.0]
            for i in range(1, 10, 3):
                counts[i % 4] += i
                if i == 7:
                    continue
                parts[-1] += helper(self.x, flip=i > 2) + helper(day.grass)
            while True:
                self.n += counts[1]
                if self.n > 5:
                    break
                self.n += 2
            for weight in WEIGHTS:
                self.y += weight * 0.5
            best = -1e9
            for part in parts:
                best = max(best, part)
            a, b = best, parts[2]
            a, b = b, a
            self.x = a - b + wander(moment.chance, 0.5) + self.rate(2) + self.drawn(moment)
            self.y = min(self.y, 3, best) + self.fixed(4) + moment.time + moment.number
            self.n = self.n * 3 // 2 - self.n % 7 + abs(-self.n) + int(self.x) + round(self.y)
            self.n = (self.n & 255) ^ (3 << 2) | ~self.n & 1

    x = np.linspace(-3, 3, 50)
    same(Bug, many(Bug, x=x), [[day()]] * 4)


def test_several_events_per_agent_in_order():
    class Target(Agent, symbol="ATarget"):
        life: float = 3.0
        log: float = 0.0
        births: int = 0

        @on("eHit")
        def hit(self, hit, moment):
            self.life -= hit.amount
            self.log = self.log * 2 + hit.amount + moment.chance.random()
            if self.life <= 0:
                return EMPTY
            if self.life < 1:
                return self.string + self.child(log=self.log) + self.child(life=0.5)

    rng = np.random.default_rng(3)
    to = Ids.numbered("a", rng.integers(0, 50, 300))
    hits = [eHit(amount=rng.random(300), receivers=to), eHit(amount=0.25), eHit(amount=0.5)]
    same(Target, many(Target), [hits, hits[:1], hits])
    few = [eHit(amount=0.5, condition="life > 1"), eHit(amount=0.1, receivers=["a7"])]
    same(Target, many(Target), [few * 3])


def test_loops_that_are_longer_than_a_call_of_the_kernel(monkeypatch):
    from minerva_fast import draws, methods

    soon = [line.replace("> 50000000", "> 20") for line in methods.LAST_TURN]
    monkeypatch.setattr(methods, "LAST_TURN", soon)
    monkeypatch.setattr(draws, "MOST_TURNS", 60)

    class Slow(Agent, symbol="ASlow"):
        n: int = 0
        births: int = 0

        @on("eDay")
        def live(self, day, moment):
            for turn in range(self.n):
                moment.emit(eEgg(size=turn))
                moment.chance.random()
            self.n += moment.chance.integers(5)
            return self.string + self.child(n=self.n)

    same(Slow, many(Slow, n=np.arange(50) * 2), [[day()]] * 2)


def test_probabilities():
    class Shy(Agent, symbol="AShy"):
        h: float = 0.5
        n: int = 0

        @on("eDay", probability="h")
        def live(self, day, moment):
            self.n += moment.chance.integers(10)

        @on("eHit", probability=0.3)
        def hit(self, hit, moment):
            self.h = min(1.0, self.h + hit.amount)

    same(Shy, many(Shy), [[day(), day(), eHit(amount=0.25), eHit(amount=0.5)]] * 3)


def test_several_children_and_one_of_another_kind():
    class Egg(Agent, symbol="AEgg"):
        size: float = 1.0

    class Hen(Agent, symbol="AHen"):
        age: int = 0
        births: int = 0

        @on("eDay")
        def live(self, day, moment):
            self.age += 1
            if self.age > 2:
                return self.child(age=-moment.chance.integers(3))
            if self.age == 2:
                return self.string + self.child(age=-1) + self.child(Egg, size=0.5) + self.child()
            return EMPTY if self.age == -1 else self.string

    same(Hen, many(Hen, 20), [[day()]] * 4)


CASES = {
    "division by zero": "self.x = 1 / self.x",
    "remainder by zero": "self.n = 5 % self.n",
    "root of a negative": "self.x = math.sqrt(self.x - 1.0)",
    "log of zero": "self.x = math.log(self.x)",
    "int of nan": "self.n = int(math.inf * self.x)",
    "not finite": "self.x = 1e308 * (10 + self.x)",
    "too large an int": "self.n = 2**62 + 2**62 + self.n",
    "index out of range": "self.x = 1.0 * WEIGHTS[self.n + 3]",
    "empty range of integers": "self.n = moment.chance.integers(self.n, 0)",
    "an error of its own": "if self.n == 0:\n    raise ValueError('no number')",
    "an assertion": "assert self.n > 0, 'a number'",
    "a range": "self.y -= 2",
}


@pytest.mark.parametrize("case", CASES)
def test_errors_are_those_of_the_method(case, tmp_path, monkeypatch):
    lines = "\n".join(f"            {line}" for line in CASES[case].split("\n"))
    (tmp_path / "odd_world.py").write_text(
        f"""
import math
import sys
from importlib import import_module
from typing import Annotated
from minerva_bus import Agent, EventType, on
from minerva_bus.grammar.types import Range
WEIGHTS = (1.0, 0.5, 2.0)
eDay = EventType("eDay", grass=float, name=str, wet=bool, count=int)

class Odd(Agent, symbol="AOdd"):
    x: float = 0.0
    n: int = 0
    y: Annotated[float, Range(least=0)] = 1.0

    @on("eDay")
    def live(self, day, moment):
        moment.chance.random()
        if self.x != 2:
{lines}
"""
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "odd_world", raising=False)
    odd_world = import_module("odd_world")

    x = np.full(40, 2.0)
    x[[17, 30]] = 0.0
    result = same(odd_world.Odd, many(odd_world.Odd, 40, x=x), [[day()]])
    assert result[0] == "ActivityError"
    assert "AOdd#a17" in result[1]
    assert "frame 0" in result[1]


def test_a_state_that_columns_cannot_hold_may_pass_within_a_frame():
    class Wave(Agent, symbol="AWave"):
        x: float = 1.0
        n: int = 0

        @on("eHit")
        def hit(self, hit, moment):
            self.n += 1
            if self.n == 2 or hit.amount == 5:
                self.x = math.inf * hit.amount
            elif self.x > 10:
                self.x = moment.chance.random()
            moment.emit(eEgg(size=self.n))

    same(
        Wave,
        many(Wave),
        [[eHit(amount=0.5)] * 3, [eHit(amount=5.0, receivers=["a3"]), eHit(amount=1.0)]],
    )


def test_ints_beyond_64_bits_within_a_method():
    class Hash(Agent, symbol="AHash"):
        n: int = 1

        @on("eDay")
        def live(self, day, moment):
            self.n = (self.n * 6364136223846793005 + 1442695040888963407) % 2**31

    same(Hash, many(Hash, 40, n=np.arange(40)), [[day()]])


def test_a_changed_constant_is_compiled_again():
    class Step(Agent, symbol="AStep"):
        x: float = 0.0

        @on("eDay")
        def live(self, day, moment):
            self.x += LIMIT

    global LIMIT
    compiled = compiled_form(Step)
    first = outcome(many(compiled, 3), [day()], [compiled], Frame())[0]
    LIMIT = 9
    try:
        assert [node.values for node in first.nodes] == [(8.0,)] * 3
        second = outcome(first, [day()], [compiled], Frame())[0]
        assert [node.values for node in second.nodes] == [(17.0,)] * 3
    finally:
        LIMIT = 8


def test_an_agent_may_emit_more_events_than_there_are_rows():
    """Half of the room for them was left, so nothing was enlarged, for ever."""

    class Singer(Agent, symbol="ASinger"):
        calls: int = 0

        @on("eDay")
        def sing(self, day, moment):
            for turn in range(self.calls):
                moment.emit(eCall(loud=1.0 * turn, word="la", receivers=[self.id]))

    calls = np.resize([1, 0, 2, 64, 300], 40)
    same(Singer, many(Singer, 40, calls=calls), [[day()], [day()]])


def test_membership_in_constant_tuples():
    class Member(Agent, symbol="AMember"):
        n: int = 0
        name: str = ""
        among: bool = False
        WANTED = (1, 2.5, True, 7)

        @on("eDay")
        def look(self, day, moment):
            self.among = self.n in self.WANTED or self.name in NAMES
            if self.n not in WEIGHTS and day.name not in NAMES:
                self.n += 1

    texts = np.resize(np.array(["a", "x", "c", ""], object), 40)
    same(Member, many(Member, 40, n=np.arange(40) % 8, name=texts), [[day()]] * 2)


def mixed(x, y=1.0, *, z=0.5):
    return x + 10 * y + 100 * z


def test_arguments_are_evaluated_in_the_order_in_which_they_are_written():
    class Player(Agent, symbol="APlayer"):
        x: float = 0.0
        births: int = 0

        @on("eDay")
        def play(self, day, moment):
            self.x = mixed(y=moment.chance.random(), x=moment.chance.random())
            self.x += mixed(
                moment.chance.random(), z=moment.chance.random(), y=moment.chance.random()
            )
            self.x += moment.chance.normal(
                mean=moment.chance.random(), deviation=moment.chance.random()
            )
            moment.emit(eCall(word="a", loud=moment.chance.random()))
            return self.string + self.child(
                births=moment.chance.integers(5), x=moment.chance.random()
            )

    same(Player, many(Player), [[day()], [day()]])


def test_texts_of_a_compiled_method_stay_coded():
    """Otherwise each frame codes, compares and checks a text for each agent."""
    from minerva_bus import evolve
    from minerva_bus.grammar.columns import Column

    class Person(Agent, symbol="APerson"):
        state: Literal["well", "ill", "immune"] = "well"
        births: int = 0

        @on("eDay", compiled=True)
        def live(self, day, moment):
            if self.state == "ill":
                self.state = "immune"
                return self.string + self.child(state="well")
            if self.state == "well" and moment.chance.random() < 0.5:
                self.state = "ill"

    def column(scene) -> Column:
        return scene.pieces[0].columns[0]

    scene = many(Person, 60)
    for number in range(3):
        scene = evolve(scene, [day()], [Person], Frame(number)).scene
        assert column(scene).words is not None
        assert set(column(scene).list()) == set(column(scene).words)
