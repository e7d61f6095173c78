"""A village: twelve agents with needs ask a language model what to do, and invite each other.

Requests, answers and conversations are events, so no villager waits for another one's thoughts.
"""

from __future__ import annotations

import math
from typing import Literal

from minerva_assistants.minds import MINDS, Mind, eAsk
from minerva_bus import (
    EMPTY,
    Context,
    Default,
    Disc,
    Event,
    EventType,
    Label,
    Line,
    Metres,
    Motion,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)
from minerva_bus.errors import MinervaError
from minerva_messages import MESSAGES, REQUEST, Conversation, Talker

NAMES = (
    *("ada", "bela", "cora", "dario", "elin", "fritz"),
    *("greta", "hugo", "ida", "jon", "kira", "lars"),
)
PLACES = {"bakery": (9.0, 12.2), "inn": (19.0, 12.2), "square": (9.0, 5.8), "field": (19.0, 5.8)}
TRADES = ("baker", "farmer", "smith", "weaver")
CENTRE, ACROSS = (14.0, 9.0), (12.5, 7.8)  # metres: of the village; half axes of its ring of homes
SIDE, SEAT, NEAR = 4.4, 1.7, 0.3  # metres: of a place; from its centre; counts as arrived
SPEED = 0.25  # metres per frame
CALM = 35.0  # below this, no need is urgent

# --- the vocabulary: pictures, plans and answers -------------------------------------------------

Points = tuple[float, ...]
PGround = Primitive(
    "PGround", Line("xs", "ys", "#dfe6cf", SIDE, meaning="a place"), xs=Points, ys=Points
)
PLawn = Primitive(
    "PLawn", Line("xs", "ys", "#f1f3e8", 18.5, meaning="the green"), xs=Points, ys=Points
)
PHome = Primitive("PHome", Disc("radius", "#d8cfc4", meaning="a home"), radius=Metres)
PVillager = Primitive("PVillager", Disc("radius", "#b5651d", meaning="a villager"), radius=Metres)
PThinker = Primitive(
    "PThinker", Disc("radius", "#5b6ee1", meaning="waits for an answer"), radius=Metres
)
PSleeper = Primitive("PSleeper", Disc("radius", "#8a8f98", meaning="sleeps"), radius=Metres)
PSign = Primitive("PSign", Label("text", "#2b2b33", meaning="a name, or words"), text=str)
TPlace = Transformation("TPlace", Motion("x", "y"), x=Metres, y=Metres)

eStep = EventType("eStep")
ePicture = EventType("ePicture", visual=True)
ePlan = EventType(
    "ePlan",
    action=Literal["eat", "sleep", "work", "meet"],
    place=Literal["bakery", "inn", "square", "field", "home"],
    friend=Default(str, ""),
    words=Default(str, ""),
)
eConsent = EventType("eConsent", agrees=bool, words=str, topic=Default(str, ""))

# --- the agents ----------------------------------------------------------------------------------


class Villager(Talker, symbol="AVillager"):
    """Plans by a model; if there is no answer, follows the most urgent need."""

    trade: str
    friends: tuple[str, ...]
    home_x: Metres
    home_y: Metres
    x: Metres
    y: Metres
    hunger: float = 0.0
    tiredness: float = 0.0
    loneliness: float = 0.0
    action: str = "work"
    place: str = "field"
    words: str = ""
    thinking: bool = False
    plans: int = 0
    meetings: int = 0

    @on("eStep")
    def live(self, step: Event, moment: Context) -> None:
        self.hunger = min(100.0, self.hunger + 0.15)
        self.tiredness = min(100.0, self.tiredness + 0.1)
        self.loneliness = min(100.0, self.loneliness + 0.12)
        self.expire(moment)
        if self.walk():
            self.act(moment)
        if not self.thinking and self.done:
            self.think(moment)

    # --- needs ---

    @property
    def needs(self) -> dict[str, float]:
        """The needs, 0 to 100."""
        return {"hunger": self.hunger, "tiredness": self.tiredness, "loneliness": self.loneliness}

    @property
    def urgent(self) -> str:
        """The most urgent need, or `none`."""
        need, value = max(self.needs.items(), key=lambda item: item[1])
        return need if value >= CALM else "none"

    @property
    def done(self) -> bool:
        """Whether the current action has no purpose any more."""
        return {
            "eat": self.hunger < 5,
            "sleep": self.tiredness < 5,
            "meet": not self.conversations(REQUEST),
            "talk": self.loneliness < 5,
            "work": self.urgent != "none",
        }[self.action]

    @property
    def target(self) -> tuple[float, float]:
        """Where the plan leads: home, or a seat of its own at a place."""
        home = self.home_x, self.home_y
        if self.place not in PLACES:
            return home
        x, y = PLACES[self.place]
        share = SEAT / portable.dist(CENTRE, home)
        return x + share * (home[0] - CENTRE[0]), y + share * (home[1] - CENTRE[1])

    def walk(self) -> bool:
        """Go on towards the place of the plan; returns whether the villager is there."""
        x, y = self.target
        left = portable.dist((self.x, self.y), (x, y))
        if left <= NEAR:
            self.words = ""
            return True
        self.x += SPEED * (x - self.x) / left
        self.y += SPEED * (y - self.y) / left
        return False

    def act(self, moment: Context) -> None:
        match self.action:
            case "eat":
                self.hunger = max(0.0, self.hunger - 2.5)
            case "sleep":
                self.tiredness = max(0.0, self.tiredness - 1.5)
            case "talk":
                self.loneliness = max(0.0, self.loneliness - 2.0)
            case "meet":
                for visit in self.conversations(REQUEST, state="agreed", role="participant"):
                    self.say(moment, visit, "inform", "I am here.")
                    self.meet()

    def meet(self) -> None:
        self.meetings += 1
        self.action = "talk"

    # --- plans ---

    def think(self, moment: Context) -> None:
        self.thinking = True
        friend = self.friends[self.plans % len(self.friends)]
        state = ", ".join(f"{need} {value:.0f}" for need, value in self.needs.items())
        prompt = (
            f"You are {self.id}, the {self.trade} of a village. Your needs, 0 to 100: {state};"
            f" most urgent: {self.urgent}. Places: {', '.join(PLACES)}, home. Eat at the bakery or"
            f" the inn, sleep at home, work in the field, or meet a friend such as {friend}."
            " What do you do next, and what do you say?"
        )
        moment.emit(eAsk(prompt, answer="ePlan", within=30, receivers=["mind"]))

    @on("ePlan")
    def follow(self, plan: Event, moment: Context) -> None:
        self.plans += 1
        if not self.begin(plan.action, plan.place, plan.words) or plan.action != "meet":
            return
        if plan.friend in self.friends:
            by = moment.number + 300
            self.open(moment, REQUEST, [plan.friend], f"{plan.words} ({plan.place})", reply_by=by)

    @on("eNoAnswer")
    def follow_instinct(self, failure: Event, moment: Context) -> None:
        if failure.topic:
            self.consent(moment, failure.topic, False, "I have no answer.")
            return
        choice = {"hunger": ("eat", "bakery"), "tiredness": ("sleep", "home")}
        self.begin(*choice.get(self.urgent, ("work", "field")), "")

    def begin(self, action: str, place: str, words: str) -> bool:
        """Begin a plan, unless the villager has agreed to meet somebody in the meantime."""
        self.thinking = False
        if self.action == "meet" and not self.done:
            return False
        self.action, self.place, self.words = action, place, words
        return True

    # --- conversations ---

    def received(self, message: Event, conversation: Conversation | None, moment: Context) -> None:
        match conversation.state if conversation else "":
            case "requested":
                prompt = (
                    f"You are {self.id}. {message.sender} asks you: {message.content!r}"
                    f" Your tiredness is {self.tiredness:.0f} of 100, your loneliness"
                    f" {self.loneliness:.0f}. Do you agree, and what do you say?"
                )
                topic = f"{conversation.id} {conversation.peer}"
                moment.emit(eAsk(prompt, "", "eConsent", topic, 15, receivers=["mind"]))
            case "done":
                self.meet()

    @on("eConsent")
    def reply(self, consent: Event, moment: Context) -> None:
        self.consent(moment, consent.topic, consent.agrees, consent.words)

    def consent(self, moment: Context, topic: str, agrees: bool, words: str) -> None:
        id, _, peer = topic.partition(" ")
        invitation = self.conversation(id, peer)
        if invitation is None or invitation.state != "requested":
            return  # It has ended meanwhile.
        self.words = words
        self.say(moment, invitation, "agree" if agrees else "refuse", words)
        if agrees:
            place = invitation.content.rpartition("(")[2].rstrip(")")
            self.action, self.place = "meet", place if place in PLACES else "square"

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        asleep = self.action == "sleep" and not self.words
        body = PThinker(0.4) if self.thinking else PSleeper(0.4) if asleep else PVillager(0.4)
        words = PSign(f"{self.id}: {self.words}") if self.words else EMPTY
        return TPlace(self.x, self.y)(body + TPlace(0.0, 0.75)(words))


vocabulary = Vocabulary.of(
    *(PLawn, PGround, PHome, PVillager, PThinker, PSleeper, PSign, TPlace, eStep, ePicture),
    *(ePlan, eConsent, Villager, *MESSAGES, *MINDS),
)


def scene(options: dict[str, int]) -> Scene:
    """The places, the homes in a ring around them, the villagers and their mind."""
    count = options["villagers"]
    if not 2 <= count <= len(NAMES):
        raise MinervaError(f"village: {count} villagers; expected 2 to {len(NAMES)}")
    string = Mind("mind").string + PLawn((7.5, 20.5), (8.6, 8.6))
    for name, (x, y) in PLACES.items():
        ground = PGround((-0.4, 0.4), (0.0, 0.0))
        string += TPlace(x, y)(ground + TPlace(0.0, -SIDE / 2 - 0.5)(PSign(name)))
    for number, name in enumerate(NAMES[:count]):
        angle = 2 * math.pi * number / count
        x = CENTRE[0] + ACROSS[0] * portable.cos(angle)
        y = CENTRE[1] + ACROSS[1] * portable.sin(angle)
        string += TPlace(x, y)(PHome(0.6) + TPlace(0.0, -1.3)(PSign(name)))
        friends = sorted({NAMES[(number + step) % count] for step in (1, 3, 5)} - {name})
        traits = {"trade": TRADES[number % 4], "friends": tuple(friends), "home_x": x, "home_y": y}
        needs = {"hunger": number * 9 % 40, "tiredness": number * 23 % 50}
        needs["loneliness"] = number * 17 % 35
        string += Villager(name, x=x, y=y, **traits, **needs).string
    return string
