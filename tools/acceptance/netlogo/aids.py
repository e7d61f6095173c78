"""AIDS (Wilensky 1997): people wander, form couples, infect each other, and learn of it late."""

import numpy as np

from minerva_bus import Reals, on, portable
from minerva_fast import (
    SHUFFLED,
    Column,
    Draws,
    Space,
    beside,
    chance,
    integers,
    random,
    rule,
    uniform,
    within,
)
from tools.acceptance.netlogo.primitives import Turtle, stand, ticking

SIDE, PEOPLE, COUPLING, COMMITMENT, SYMPTOMS = 25, 300, 5.0, 50.0, 200.0
ALONE, HEALTHY, INFECTED, KNOWN = -1, 0, 1, 2


class Person(Turtle):
    asks: Column  # whether it proposes, to those who do not
    coupling: Column
    commitment: Column
    partner: Column  # the row, or ALONE
    together: Column  # weeks
    infected: Column  # HEALTHY, INFECTED, or KNOWN
    weeks: Column  # since the infection


@rule(SHUFFLED)
def wander(i: int, people: Person, draws: Draws):
    people.weeks[i] += people.infected[i] != HEALTHY
    people.together[i] += people.partner[i] != ALONE
    if people.partner[i] == ALONE:
        angle = uniform(draws, 0.0, 2 * np.pi)
        stand(people, i, people.x[i] + portable.cos(angle), people.y[i] + portable.sin(angle))


@rule(SHUFFLED)
def propose(i: int, people: Person, draws: Draws):
    asks = people.partner[i] == ALONE and people.asks[i] == 1
    if asks and random(draws) * 10 < people.coupling[i]:
        count, other = 0, ALONE
        for k in range(within(people, beside(people.lattice, people.cell[i], -1, 0), 0)):
            j = people.nearby[k]
            if people.partner[j] == ALONE and people.asks[j] == 0:
                count += 1
                other = j if integers(draws, count) == 0 else other
        if other != ALONE and random(draws) * 10 < people.coupling[other]:
            people.partner[i], people.partner[other] = other, i
            stand(people, i, int(people.x[i]) + 0.5, int(people.y[i]) + 0.5)
            stand(people, other, int(people.x[other]) + 0.5, int(people.y[other]) + 0.5)


@rule(SHUFFLED)
def part(i: int, people: Person):
    other = int(people.partner[i])
    if other != ALONE and people.together[i] > min(people.commitment[i], people.commitment[other]):
        people.partner[i] = people.partner[other] = ALONE
        people.together[i] = people.together[other] = 0


@rule(SHUFFLED)
def infect(i: int, people: Person, draws: Draws):
    other = int(people.partner[i])
    if other != ALONE and people.infected[i] == INFECTED and chance(draws, 0.5):
        people.infected[other] = max(people.infected[other], INFECTED)
    if people.weeks[i] > SYMPTOMS and chance(draws, 0.05):
        people.infected[i] = KNOWN


class Town(Space, symbol="ATown"):
    people: Reals

    @on("eStep")
    def step(self, step, moment):
        self.run(moment, wander, propose, part, infect)


def world(seed):
    draw = np.random.default_rng(seed)
    (x, y), infected = draw.uniform(0, SIDE, (2, PEOPLE)), np.arange(PEOPLE) < PEOPLE * 0.025
    coupling, commitment = (draw.uniform(0, mean, (PEOPLE, 40)).sum(axis=1) / 20
                            for mean in (COUPLING, COMMITMENT))  # fmt: skip
    people = Person.many(PEOPLE, cell=y.astype(int) * SIDE + x.astype(int), x=x, y=y,
                         asks=draw.integers(0, 2, PEOPLE), coupling=coupling,
                         commitment=commitment, partner=ALONE, together=0, infected=infected,
                         weeks=infected * draw.uniform(0, SYMPTOMS, PEOPLE))  # fmt: skip
    size = {"width": SIDE, "height": SIDE, "births": PEOPLE}
    return ticking(Town("town", periodic=True, people=people, **size))


def shown(state):
    """Who is infected, who knows it, and who is in a couple."""
    people = Person.read(state["people"])
    return people.infected != HEALTHY, people.infected == KNOWN, people.partner != ALONE
