"""Plants that grow by an L-system: buds rewrite themselves, and stop without free space.

A bud is an agent with a rule for its replacement, in Lindenmayer's notation: F is a stem, X a bud,
Y a weaker one, + and - turns, [ ] a branch. The symbols after a stem or a turn are at its end and
therefore in its scope: the brackets of an L-system are those of the grammar.
"""

from __future__ import annotations

from minerva_bus import (
    EMPTY,
    Agent,
    Cells,
    Context,
    Degrees,
    Disc,
    Event,
    EventType,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)

# --- the vocabulary -------------------------------------------------------------------------------

WOOD = (
    ("PSprout", "#7f9f4d", 0.03),
    ("PTwig", "#8a8a4f", 0.05),
    ("PBranch", "#84704c", 0.08),
    ("PBough", "#765f46", 0.12),
    ("PTrunk", "#6a5442", 0.17),
)


def wood(name: str, color: str, width: float) -> Primitive:
    line = Line("xs", "ys", color, width)
    return Primitive(name, line, xs=tuple[float, ...], ys=tuple[float, ...])


woods = [wood(*spot) for spot in WOOD]
PLeaf = Primitive("PLeaf", Disc(0.1, "#5f9a4a"))
PFlower = Primitive("PFlower", Disc(0.09, "#c9407f"))
PTip = Primitive("PTip", Disc(0.06, "#9bc265", meaning="growing tip"))
PSky = Primitive("PSky", Raster("cells", 1.0, colors=((0, "#eaf2f4"),)), cells=Cells)
PSoil = Primitive(
    "PSoil", Raster("cells", 1.0, y=-1.0, colors=((0, "#a98f6f"),), height=0.1), cells=Cells
)
PRoom = Primitive("PRoom", Disc("radius"), radius=Metres, who=str)
PBark = Primitive(
    "PBark", Line("xs", "ys", width=0.04), xs=tuple[float, ...], ys=tuple[float, ...], who=str
)
TPlace = Transformation("TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Degrees)
TTurn = Transformation("TTurn", Motion(turn="angle"), angle=Degrees)
TForward = Transformation("TForward", Motion(forward="dist"), dist=Metres)

eGrow = EventType("eGrow")
eCollision = EventType("eCollision")
eBody = EventType("eBody", visual=True)
ePicture = EventType("ePicture", visual=True)

AHEAD, ROOM = (
    0.6,
    0.2,
)  # centre and radius of the space for a bud, per length

# --- the agents -----------------------------------------------------------------------------------


class Stem(Agent, symbol="AStem"):
    """Grows thicker; its scope is drawn at its end."""

    length: Metres
    age: int = 0

    @on("eGrow")
    def thicken(self, grow: Event, moment: Context) -> None:
        self.age += 1

    @view("eBody")
    def body(self, event: Event) -> Scene:
        bark = PBark((0.3 * self.length, 0.8 * self.length), (0.0, 0.0), self.id)
        return bark + TForward(self.length)(self.scope)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        wood = woods[min(self.age, 2 * len(woods) - 1) // 2]
        leaves = TTurn(50.0)(TForward(0.12)(PLeaf())) + TTurn(-50.0)(TForward(0.12)(PLeaf()))
        end = self.scope + (leaves if self.age < 4 else EMPTY)
        return wood((0.0, self.length), (0.0, 0.0)) + TForward(self.length)(end)


class Bud(Agent, symbol="ABud"):
    """Is replaced according to its rule, or by a flower if its space is occupied."""

    rule: str
    fork: Degrees = 25.0
    length: Metres = 1.0
    shrink: float = 0.85
    orders: int = 6
    crowded: bool = False
    births: int = 0

    @on("eCollision")
    def feel(self, touch: Event, moment: Context) -> None:
        self.crowded = True

    @on("eGrow")
    def grow(self, grow: Event, moment: Context) -> Scene:
        if self.crowded or not self.orders:
            return PFlower()
        return self.become(list(self.rule), moment)

    def become(self, rule: list[str], moment: Context) -> Scene:
        """The string of a rule up to its end or the end of its branch; consumes the rule."""
        string = EMPTY
        while rule and (sign := rule.pop(0)) != "]":
            if sign in "XY":
                string += self.heir(1 if sign == "X" else 2)
            elif sign == "[":
                string += self.become(rule, moment)
            elif sign == "F":
                rest = self.become(rule, moment)
                return string + self.child(Stem, length=self.length, scope=rest)
            elif sign in "+-":
                turn = float(f"{sign}1") * self.fork + moment.chance.normal(0.0, 5.0)
                return string + TTurn(turn)(self.become(rule, moment))
        return string

    def heir(self, orders: int) -> Scene:
        """A bud that is `orders` orders higher: smaller, and with fewer orders left."""
        return self.child(
            rule=self.rule,
            fork=self.fork,
            length=self.length * portable.power(self.shrink, orders),
            shrink=self.shrink,
            orders=max(0, self.orders - orders),
        )

    @view("eBody")
    def body(self, event: Event) -> Scene:
        return TForward(AHEAD * self.length)(PRoom(ROOM * self.length, self.id))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        return PTip()


vocabulary = Vocabulary.of(
    *(*woods, PLeaf, PFlower, PTip, PSky, PSoil, PRoom, PBark, TPlace, TTurn, TForward),
    *(eGrow, eCollision, eBody, ePicture, Stem, Bud),
)
