"""Types of values: accepted, converted and rejected values, their ranges and texts."""

import math
from typing import Annotated, Literal

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from minerva_bus import (
    Cells,
    Degrees,
    EventType,
    Metres,
    MetresPerSecond,
    Of,
    Primitive,
    Reals,
    Scene,
    Transformation,
    Vocabulary,
    parse,
)
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Column, fits, values_of
from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.types import Quantity, Range, Type, Unfit, parse_type, type_of
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary


def fit(annotation, value):
    return type_of(annotation).fit(value)


@pytest.mark.parametrize(
    ("annotation", "value", "expected"),
    [
        (bool, True, True),
        (bool, np.bool_(False), False),
        (int, 3, 3),
        (int, 3.0, 3),
        (int, np.int16(3), 3),
        (int, np.uint64(3), 3),
        (int, -(1 << 63), -(1 << 63)),
        (float, 1, 1.0),
        (float, np.float32(0.5), 0.5),
        (float, np.int64(2), 2.0),
        (Metres, 1.5, 1.5),
        (str, "é", "é"),
        (str, np.str_("x"), "x"),
        (tuple[int, ...], [1, 2.0], (1, 2)),
        (tuple[tuple[float, ...], ...], ((1,), ()), ((1.0,), ())),
        (Scene, parse("PA"), parse("PA")),
    ],
)
def test_values_that_fit(annotation, value, expected):
    fitted = fit(annotation, value)
    assert fitted == expected
    assert type(fitted) is type(expected)


@pytest.mark.parametrize(
    ("annotation", "value", "said"),
    [
        (bool, 1, "true or false, not 1"),
        (int, True, "a whole number, not True"),
        (int, 1.5, "a whole number, not 1.5"),
        (int, 1 << 63, "at most 64 bits"),
        (int, np.uint64(1 << 63), "at most 64 bits"),
        (int, "1", "a whole number, not '1'"),
        (int, math.inf, "a whole number, not inf"),
        (int, math.nan, "a whole number, not nan"),
        (float, True, "a number, not True"),
        (float, math.nan, "a finite number"),
        (float, -math.inf, "a finite number"),
        (float, 10**400, "a finite number"),
        (float, np.complex128(1), "a number, not a complex128"),
        (float, np.zeros((1, 1)), "a number, not a matrix"),
        (float, None, "a number, not a NoneType"),
        (str, 1, "a text, not 1"),
        (str, "\ud800", "surrogate"),
        (tuple[int, ...], 1, "a list of int, not 1"),
        (tuple[int, ...], [1, "x"], "a whole number, not 'x'"),
        (tuple[int, ...], (1, True), "a whole number, not True"),
        (tuple[int, ...], (1, 1 << 63), "at most 64 bits"),
        (tuple[float, ...], (1.0, math.nan), "a finite number"),
        (tuple[str, ...], ("a", "\ud800"), "surrogate"),
        (tuple[Literal["a"], ...], ("b",), "one of a"),
        (tuple[Annotated[int, Range(1, 9)], ...], (10,), "from 1 to 9"),
        (Scene, "PA", "a string in braces, not 'PA'"),
        (Cells, [[1]], "a matrix RxC[...], not a list"),
        (Cells, np.zeros(3, np.int16), "a matrix RxC"),
        (Cells, np.zeros((2, 2)), "a matrix of whole numbers"),
        (Cells, np.full((2, 2), 40_000), "whole numbers of 16 bits"),
        (Reals, np.full((2, 2), np.nan), "a matrix of finite numbers"),
        (Reals, np.full((2, 2), "x"), "a matrix of numbers"),
        (Reals, np.full((2, 2), 1j), "a matrix of numbers"),
        (Reals, np.full((2, 2), None), "a matrix of numbers"),
        (float, Quantity(1.0, "m"), "a number, not 1 m"),
        (int, Quantity(1.0, "m"), "a whole number, not 1 m"),
    ],
)
def test_values_that_do_not_fit(annotation, value, said):
    with pytest.raises(Unfit) as caught:
        fit(annotation, value)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "number", "given", "expected"),
    [
        ("m", 150.0, "cm", 1.5),
        ("m", 57.0, "cm", 0.57),
        ("m", 2.0, "km", 2000.0),
        ("m", 7.0, "mm", 0.007),
        ("km", 5.0, "m", 0.005),
        ("m", 0.1, "m", 0.1),
        ("deg", 90.0, "°", 90.0),
        ("deg", math.pi, "rad", 180.0),
        ("rad", 180.0, "deg", math.pi),
        ("m/s", 36.0, "km/h", 10.0),
        ("km/h", 10.0, "m/s", 36.0),
        ("s", 1.0, "h", 3600.0),
        ("kg", 250.0, "g", 0.25),
    ],
)
def test_units_convert_within_their_dimension(unit, number, given, expected):
    assert parse_type(f"real {unit}").fit(Quantity(number, given)) == expected


@pytest.mark.parametrize("given", ["deg", "s", "m/s", "kg", "parsec", "M"])
def test_units_of_another_dimension_or_none_at_all_are_refused(given):
    with pytest.raises(Unfit, match="a number in m, not 1 "):
        fit(Metres, Quantity(1.0, given))


def test_a_conversion_that_overflows_is_refused():
    with pytest.raises(Unfit, match="a finite number"):
        fit(Metres, Quantity(1e308, "km"))


def test_a_value_in_its_final_form_is_the_very_value():
    for annotation, value in [
        (float, 1.5),
        (str, "long enough a text"),
        (tuple[float, ...], (1.5, 2.5)),
        (Scene, parse("PA")),
    ]:
        assert fit(annotation, value) is value
    cells = fit(Cells, np.zeros((2, 2), np.int16))
    assert fit(Cells, cells) is cells


def test_a_matrix_from_a_text_or_from_bytes_is_not_copied():
    (figure,) = parse("PA<m=1x2[1 2]>")
    (matrix,) = figure.values
    assert fit(Cells, matrix) is matrix
    received = np.frombuffer(bytes(8), np.int16).reshape(2, 2)
    assert fit(Cells, received) is received


@pytest.mark.parametrize("annotation", [Cells, Reals])
def test_a_stored_matrix_is_read_only(annotation):
    dtype = np.int16 if annotation is Cells else np.float64
    matrix = np.zeros((2, 3), dtype)
    fitted = fit(annotation, matrix)
    matrix[0, 0] = 7
    assert fitted[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        fitted[0, 0] = 1
    assert matrix.flags.writeable


def test_a_read_only_view_of_what_can_be_written_is_copied():
    matrix = np.zeros((4, 3), np.int16)
    window = matrix[1:]
    window.flags.writeable = False
    fitted = fit(Cells, window)
    matrix[1, 0] = 7
    assert fitted[0, 0] == 0


def test_a_matrix_that_is_writable_again_is_checked_again():
    matrix = fit(Reals, np.ones((2, 2)))
    assert fit(Reals, matrix) is matrix
    matrix.flags.writeable = True
    matrix[0, 0] = math.nan
    with pytest.raises(Unfit, match="finite"):
        fit(Reals, matrix)


@pytest.mark.parametrize(
    ("annotation", "wrong"),
    [(bool, (1, 1.5, None)), (int, (True, 1 << 63, -(1 << 63) - 1, 1.5))],
)
def test_fields_refuse_ints_for_bools_and_bools_for_ints(annotation, wrong):
    fields = Fields.of({"number": annotation})
    assert fields.fitted("P", [annotation(1)]) == [annotation(1)]
    for value in wrong:
        with pytest.raises(Unfit, match="number must be"):
            fields.fitted("P", [value])


@pytest.mark.parametrize(
    "matrix",
    [
        np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3)),
        np.arange(6, dtype=">i2").reshape(2, 3),
        np.arange(6, dtype=np.uint8).reshape(2, 3),
        np.ma.masked_array(np.arange(6, dtype=np.int16).reshape(2, 3)),
        np.arange(12, dtype=np.int16).reshape(2, 6)[:, ::2] // 2,
    ],
    ids=["fortran", "big endian", "bytes", "masked", "strided"],
)
def test_matrices_of_any_layout_become_one(matrix):
    fitted = fit(Cells, matrix)
    assert type(fitted) is np.ndarray
    assert fitted.dtype == np.int16
    assert fitted.flags.c_contiguous
    assert fitted.tolist() == [[0, 1, 2], [3, 4, 5]]


def deep(levels, make):
    value = make(None)
    for _ in range(levels - 1):
        value = make(value)
    return value


def braces(inner):
    from minerva_bus.grammar.scene import FigureNode, scene_of

    if inner is None:
        return scene_of(FigureNode("PA"))
    return scene_of(FigureNode("PA", ("w",), (inner,)))


@pytest.mark.parametrize("levels", [1, 32])
def test_strings_in_strings_fit_as_deep_as_a_text_has_them(levels):
    value = deep(levels, braces)
    assert fit(Scene, value) is value
    assert parse(f"PA<w={{{value}}}>").nodes[0].values[0] == value


@pytest.mark.parametrize("levels", [33, 100_000])
def test_strings_in_strings_do_not_fit_deeper(levels):
    with pytest.raises(Unfit, match="at most 32 deep"):
        fit(Scene, deep(levels, braces))


def test_lists_count_as_levels_too():
    fit(tuple[Scene, ...], (deep(31, braces),))
    with pytest.raises(Unfit, match="at most 32 deep"):
        fit(tuple[Scene, ...], (deep(32, braces),))


@pytest.mark.parametrize(
    "text",
    ["bool", "int", "real", "real m/s", "text", "list of list of real deg", "cells", "string"],
)
def test_a_type_reads_back_from_its_text(text):
    assert str(parse_type(text)) == text


@pytest.mark.parametrize(
    "text",
    ["", "float", "list of", "list of x", "real parsec", "real m m", "int m", "list of " * 99],
)
def test_invalid_types(text):
    with pytest.raises(MisuseError):
        parse_type(text)


def test_annotations_stand_for_types():
    assert type_of(Degrees) == Type("real", "deg")
    assert type_of("list of text") == Type("list", item=Type("text"))


@pytest.mark.parametrize("annotation", [dict, list[int], None, int | str, [], tuple[int, int]])
def test_texts_that_name_no_type(annotation):
    with pytest.raises(MisuseError, match="not a parameter type"):
        type_of(annotation)


def test_only_reals_have_units():
    from typing import Annotated

    from minerva_bus.grammar.types import Unit

    with pytest.raises(MisuseError, match="m is for real, not for int"):
        type_of(Annotated[int, Unit("m")])
    with pytest.raises(MisuseError, match="unknown unit 'parsec'"):
        Unit("parsec")


NUMBERS = st.one_of(
    st.integers(-3, 3), st.floats(-3, 3), st.sampled_from([10**400, 2**63, math.nan, True, "a"])
)


def each_alone(kind, value):
    """A list fitted item by item."""
    if kind.item is None:
        return kind.fit(value)
    if not isinstance(value, tuple | list):
        raise Unfit("no list")
    return tuple([each_alone(kind.item, item) for item in value])


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(["real", "int", "real 0..2", "bool", "text"]),
    st.lists(st.lists(NUMBERS, max_size=3).map(tuple) | st.lists(NUMBERS, max_size=3), max_size=4),
)
def test_lists_are_fitted_as_their_items_are(item, lists):
    kind = parse_type(f"list of list of {item}")
    try:
        expected = each_alone(kind, lists)
    except Unfit:
        with pytest.raises(Unfit):
            kind.fit(tuple(lists))
        return
    fitted = kind.fit(tuple(lists))
    assert repr(fitted) == repr(expected)  # 1.0 is not 1.
    assert kind.fit(fitted) is fitted  # So that an unchanged value is recognized.


class Word(str):
    """A text of another class."""

    __slots__ = ()


RAW = {
    "real": st.sampled_from([0.5, -0.0, 1e300, 1.5, math.nan, -math.inf]),
    "int": st.sampled_from([0, 3, 2**63 - 1, -(2**63), 2**63, -(2**63) - 1]),
    "text": st.sampled_from(["", "a", "b", "ab", "é"]),
    "bool": st.booleans(),
}
"""Values of the class of a type: most need no conversion, the others are just beyond."""

WRONG = st.sampled_from(
    [True, 3, 2**63, -(2**63) - 1, 1.5, 2.0, math.nan, -math.inf, "a", "é", "\ud800", Word("a")]
    + [np.float64(1.5), np.int16(2), np.bool_(True), Quantity(1.0, "m"), (1.0,), None]
)
SHAPES = st.lists(
    st.sampled_from(
        ["real", "real m", "int", "text", "bool", "int 0..5", "text a|b", "list of real"]
    ),
    min_size=1,
    max_size=3,
)


@st.composite
def fields_and_rows(draw):
    """Fields, and rows of values for them, most of which need no conversion."""
    texts = draw(SHAPES)
    fields = Fields(tuple(Field(f"f{n}", parse_type(text)) for n, text in enumerate(texts)))
    usual = [RAW.get(text.split()[0], WRONG) for text in texts]
    row = st.tuples(*usual) | st.tuples(*[value | WRONG for value in usual])
    return fields, draw(st.lists(row, min_size=1, max_size=3))


def fitted_alone(fields, row):
    """Each value fitted by its type; None if one does not fit."""
    try:
        return [field.type.fit(value) for field, value in zip(fields.all, row, strict=True)]
    except Unfit:
        return None


@settings(max_examples=200, deadline=None)
@given(fields_and_rows())
def test_fast_checks_of_fields_agree_with_their_types(drawn):
    """`fitted`, `is_final` and `are_final` are faster forms of `Type.fit`."""
    fields, rows = drawn
    final = [fields.is_final(row) for row in rows]
    assert fields.are_final(zip(*rows, strict=True)) == all(final)
    for row, is_final in zip(rows, final, strict=True):
        expected = fitted_alone(fields, row)
        if expected is None:
            with pytest.raises(Unfit):
                fields.fitted("PBox", row)
            assert not is_final
            continue
        fitted = fields.fitted("PBox", row)
        same = [value is other for value, other in zip(fitted, row, strict=True)]
        assert [(type(v), v) for v in fitted] == [(type(v), v) for v in expected]
        # Final values stay the same objects. All others of these types are converted, but for
        # those of which only `Type.fit` knows: other letters, ranges, words and lists.
        assert all(same) or not is_final
        simple = all(field.type.words == () and not field.type.range for field in fields.all)
        simple &= all(field.type.item is None for field in fields.all)
        if all(same) and simple and all(str(value).isascii() for value in row):
            assert is_final


eSpeed = EventType("eSpeed", speed=Annotated[MetresPerSecond, Range(least=0.0)])
eThrow = EventType("eThrow", dice=Annotated[int, Range(1, 6)])
PMark = Primitive("PMark", name=str)
TAt = Transformation("TAt", x=float)


def test_a_number_outside_its_range_is_refused_with_what_is_expected():
    assert eSpeed(0.0).speed == 0.0
    with pytest.raises(MisuseError, match=r"eSpeed: speed must be a number in m/s from 0 up, not"):
        eSpeed(-1.0)
    with pytest.raises(MisuseError, match=r"from 0 up"):
        eSpeed(-1)
    with pytest.raises(MisuseError, match=r"dice must be a number from 1 to 6, not 7"):
        eThrow(7)


def test_arrays_are_held_to_a_range_too():
    assert len(eSpeed(np.array([0.0, 2.0]))) == 2
    with pytest.raises(MisuseError, match=r"from 0 up, not -0\.5"):
        eSpeed(np.array([1.0, -0.5]))
    kind = eSpeed.fields.all[0].type
    assert fits(kind, Column(np.array([0.0, 2.0])))
    assert not fits(kind, Column(np.array([2.0, -0.5])))
    assert not fits(kind, Column(np.array([2.0, np.nan, 1.0])))
    assert fits(kind, Column(np.empty(0)))


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.floats(-2e9, 2e9))
def test_a_type_with_a_range_reads_back_and_holds_what_lies_in_it(first, other, number):
    kind = Type("real", "m", range=Range(min(first, other), max(first, other)))
    assert parse_type(str(kind)) == kind
    if min(first, other) <= number <= max(first, other):
        assert kind.fit(number) == number
    else:
        with pytest.raises(Unfit):
            kind.fit(number)


@pytest.mark.parametrize("text", ["real m/s 0..", "int ..6", "real 0.5..1", "text of PMark.name"])
def test_texts_of_types_read_back(text):
    assert str(parse_type(text)) == text


@pytest.mark.parametrize("text", ["real m 2..1", "real ..", "text 0..", "int a..", "text of name"])
def test_texts_that_name_no_range_are_refused(text):
    with pytest.raises(MisuseError):
        parse_type(text)


def test_they_travel_with_the_vocabulary():
    eGo = EventType("eGo", to=Annotated[str, Of("PMark", "name")])
    vocabulary = Vocabulary.of(eSpeed, eThrow, eGo, PMark)
    again = read_vocabulary(plain_vocabulary(vocabulary))
    for name, declared in vocabulary.events.items():
        assert again.events[name].fields == declared.fields


def test_a_vocabulary_rejects_them_where_they_do_not_fit():
    with pytest.raises(MisuseError, match=r"PDot: x is a real 0\.\.; only data of event types"):
        Vocabulary.of(Primitive("PDot", x=Annotated[float, Range(least=0.0)]))
    eGo = EventType("eGo", to=Annotated[str, Of("PMark", "nam")])
    with pytest.raises(MisuseError, match=r"eGo: to is a text of PMark\.nam.*did you mean 'PMark"):
        Vocabulary.of(eGo, PMark)
    with pytest.raises(MisuseError, match="is for real or int, not for text"):
        type_of(Annotated[str, Range(0, 1)])


def test_values_of_a_parameter_are_found_wherever_they_stand():
    names = np.array([f"m{number}" for number in range(40)], dtype=object)
    scene = parse('TAt<x=1>(PMark<name="a"> · TAt<x=2>(PMark<name="b">))')
    scene += TAt(np.arange(40.0))(PMark(names))
    assert list(values_of(scene, Of("PMark", "name"))) == ["a", "b", *names]
    assert list(values_of(scene, Of("TAt", "x")))[:3] == [1, 2, 0.0]
