"""The examples in docstrings of the public interface give the results that they show."""

import doctest

import pytest

import minerva_bus
from minerva_bus import Disc, EventType, Metres, Motion, Primitive, Transformation

NUMPY = {"Cells", "Reals"}
ELSEWHERE = {
    *("Live", "World", "connect", "run"),
}
"""Examples that need a world, a record or a running world; the docs run such code."""


def names():
    """What the examples take for granted, and every public name."""
    public = {name: getattr(minerva_bus, name) for name in minerva_bus.__all__}
    snail = Primitive("PSnail", Disc(0.2))
    at = Transformation("TAt", Motion(x="x", y="y"), x=Metres, y=Metres)
    hunger = EventType("eHunger", amount=float)
    call, rain = EventType("eCall", loud=float), EventType("eRain")
    picture = EventType("ePicture", visual=True)

    class Fox(minerva_bus.Agent, symbol="AFox"):
        x: Metres = 0.0
        energy: float = 10.0

        @minerva_bus.on("eHunger")
        def starve(self, event, moment):
            self.energy -= event.amount
            return minerva_bus.EMPTY if self.energy <= 0 else None

        @minerva_bus.view("ePicture")
        def picture(self, event):
            return at(self.x, 0.0)(snail())

    made = {"PSnail": snail, "TAt": at, "Fox": Fox, "eHunger": hunger, "eCall": call}
    return public | made | {"eRain": rain, "ePicture": picture}


def examples():
    finder = doctest.DocTestFinder()
    for name in sorted(set(minerva_bus.__all__) - ELSEWHERE - NUMPY):
        for test in finder.find(getattr(minerva_bus, name), name, module=False, globs={}):
            if test.examples:
                yield test


@pytest.mark.parametrize("test", list(examples()), ids=lambda test: test.name)
def test_an_example_gives_what_it_shows(test):
    test.globs = names()
    output = []
    result = doctest.DocTestRunner().run(test, out=output.append)
    assert result.attempted
    assert not result.failed, "".join(output)


def test_the_principal_classes_and_functions_have_examples():
    tested = {test.name for test in examples()}
    assert tested >= {"Agent", "on", "view", "Context", "EventType", "Primitive", "evolve"}
