"""The garden of the README: its vocabulary for members in all languages, snails and a picture."""

from pathlib import Path

from minerva_bus import (
    EMPTY,
    Agent,
    Default,
    Device,
    EventType,
    Primitive,
    View,
    Vocabulary,
    on,
    view,
)

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


class Picture(Device, draws=("eShow",), when="each 10 frames"):
    """Draws the shells as circles in garden.svg, beside this file."""

    def __init__(self) -> None:
        self.shells = 0

    def show(self, view: View) -> None:
        """Write the picture."""
        sizes = [node.values[0] for node in view.scene.nodes]
        self.shells = len(sizes)
        circles = "".join(
            f'<circle cx="{20 + 30 * place}" cy="40" r="{2 * size:.4f}" fill="#886644"/>'
            for place, size in enumerate(sizes)
        )
        title = f'<text x="5" y="12" font-size="10">frame {view.frame}: {self.shells} snails</text>'
        box = f'viewBox="0 0 {10 + 30 * max(self.shells, 5)} 60"'
        text = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{title}{circles}</svg>\n'
        Path(__file__).with_name("garden.svg").write_text(text, encoding="utf-8")

    def report(self) -> dict:
        """Number of shells in the last view."""
        return {"shells": self.shells}


vocabulary = Vocabulary.of(PShell, eRain, eSun, eShow, Snail)
