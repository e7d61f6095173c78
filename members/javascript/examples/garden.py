"""The vocabulary of the garden in the README, with a view: names and types that all members share.

`Snail` is also the Python counterpart of snails.js: `agents = "garden:Snail"` in place of
`command = ["node", "snails.js"]` gives the same string.
"""

from minerva_bus import EMPTY, Agent, Default, EventType, Primitive, Vocabulary, on, view

PShell = Primitive("PShell", size=float)
eRain = EventType("eRain")
eSun = EventType("eSun", heat=Default(float, 0.2))
eShow = EventType("eShow", visual=True)


class Snail(Agent, symbol="ASnail"):
    """A snail drinks in the rain, divides when it is full, and dies when it is dry."""

    water: float = 3.0
    births: int = 0

    @on("eRain")
    def drink(self, rain, moment):
        """Drink, and divide."""
        self.water += moment.chance.random()
        if self.water > 5:
            self.water /= 2
            return self.string + self.child(water=self.water)

    @on("eSun")
    def dry(self, sun, moment):
        """Dry, and die."""
        self.water -= sun.heat
        if self.water <= 0:
            return EMPTY

    @view("eShow")
    def show(self, show):
        """A shell as large as the snail is wet."""
        return PShell(self.water)


vocabulary = Vocabulary.of(PShell, eRain, eSun, eShow, Snail)
