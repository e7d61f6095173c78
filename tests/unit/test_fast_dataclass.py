"""Classes of values have the methods that `dataclass` makes, but share them."""

from dataclasses import dataclass, field, replace

import pytest

from minerva_bus.values import fast_dataclass


def classes(decorate):
    @decorate
    class Empty:
        pass

    @decorate
    class Pair:
        left: int
        right: object = None

    @decorate
    class Partial:
        key: str
        note: str = field(default="", compare=False)
        secret: str = field(default="", repr=False)

    return Empty, Pair, Partial


FAST, PLAIN = classes(fast_dataclass), classes(dataclass(frozen=True, slots=True))
ARGUMENTS = [
    (0, ()),
    (1, (1,)),
    (1, (1, "x")),
    (1, (2, (1,))),
    (2, ("a", "n", "s")),
    (2, ("a", "m", "s")),
]


def made(family):
    return [family[number](*arguments) for number, arguments in ARGUMENTS]


def test_they_are_equal_and_printed_as_those_of_dataclasses():
    fast, plain = made(FAST), made(PLAIN)
    assert [[a == b for b in fast] for a in made(FAST)] == [
        [a == b for b in plain] for a in made(PLAIN)
    ]
    assert list(map(repr, fast)) == list(map(repr, plain))
    assert len({*fast, *made(FAST)}) == len({*plain, *made(PLAIN)})


def test_a_value_of_another_class_is_another_value():
    @fast_dataclass
    class Wider(FAST[1]):
        pass

    assert Wider(1, 2) != FAST[1](1, 2)
    assert FAST[1](1, 2) != (1, 2)
    assert FAST[1](1, float("nan")) != FAST[1](1, float("nan"))
    value = FAST[1](1, float("nan"))
    assert value == replace(value)  # As tuples, which compare the identity of an item first.


def test_methods_of_the_class_stay():
    @fast_dataclass
    class Own:
        number: int

        def __eq__(self, other):
            return True

        def __repr__(self):
            return "own"

    assert Own(1) == Own(2)
    assert repr(Own(1)) == "own"
    assert hash(Own(1)) == hash(Own(1))


def test_a_value_with_a_part_that_cannot_be_hashed_cannot_be_hashed():
    with pytest.raises(TypeError, match="unhashable"):
        hash(FAST[1](1, []))


def test_it_has_no_other_attributes():
    with pytest.raises(AttributeError):
        FAST[1](1).other = 2
