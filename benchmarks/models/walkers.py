"""Agents that walk at random: all of them change in every frame."""

from minerva_bus import Agent, Context, Degrees, EventType, Metres, Primitive, Vocabulary, on

PDot = Primitive("PDot")
eStep = EventType("eStep")


class Walker(Agent, symbol="AWalker"):
    """Turns slightly and moves on."""

    x: Metres = 0.0
    y: Metres = 0.0
    heading: Degrees = 0.0

    @on("eStep")
    def walk(self, step: object, moment: Context) -> None:
        """Move about a tenth of a metre."""
        self.heading += float(moment.random.normal(0.0, 5.0))
        self.x += 0.1 * float(moment.random.normal(1.0, 0.1))
        self.y += 0.1 * float(moment.random.normal(0.0, 0.1))


vocabulary = Vocabulary.of(PDot, eStep, Walker)
