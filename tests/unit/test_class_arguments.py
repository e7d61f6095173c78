"""Class arguments of services: unknown ones are errors that name those that there are."""

import pytest

from minerva_bus import Device, Generator
from minerva_bus.errors import MisuseError


@pytest.mark.parametrize(
    ("bases", "argument", "problem"),
    [
        ((Generator,), "event", "Odd has the unknown class argument event; did you mean 'events'?"),
        ((Generator,), "generates", "generates; it may have events, when"),
        ((Generator,), "draws", "draws; it may have events, when"),
        ((Device,), "every", "every; it may have draws, coupled, when"),
        ((Generator, Device), "draw", "draw; did you mean 'draws'?"),
    ],
)
def test_an_unknown_argument_is_named(bases, argument, problem):
    with pytest.raises(MisuseError) as caught:
        type("Odd", bases, {}, **{argument: ("eHonk",)})
    assert problem in str(caught.value)


def test_another_base_class_may_have_arguments():
    class Tagged:
        tag = ""

        def __init_subclass__(cls, tag="", **rest):
            super().__init_subclass__(**rest)
            cls.tag = tag

    for bases in ((Generator, Tagged), (Tagged, Generator)):
        made = type("Odd", bases, {}, tag="a", events=("eHonk",))
        assert (made.tag, made.events) == ("a", ("eHonk",))
