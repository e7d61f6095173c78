"""World files as TOML, of any content."""

import tomllib

import hypothesis.strategies as st
import pytest
from hypothesis import given

from minerva_bus.launch.toml_tables import (
    MAX_KEY_PARTS,
    TomlError,
    extended,
    read_toml,
    toml_value,
    toml_value_text,
)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a = " + "[" * 100_000, "nested too deeply"),
        ("a = " + "{b = " * 100_000, "nested too deeply"),
        ("a = " + "1" * 100_000, "4300 digits"),
        (".".join(["a"] * 200_000) + " = 1", "more than 64 parts"),
        ("[" + " . ".join(["a"] * 200_000) + "]", "more than 64 parts"),
        ("x = {" + ".".join(["'a'", '"b"'] * 200) + " = 1}", "more than 64 parts"),
        ("a = ", "Invalid value"),
    ],
)
def test_an_unreadable_file_is_rejected_with_a_reason(text, problem):
    with pytest.raises(TomlError, match=problem):
        read_toml(text)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("lines", "line", "column"),
    [
        (["[world]", "frames = = 5", ""], 2, 10),
        (["frames = = 5"], 1, 10),
        (["[world]", "", "scene = dots:scene", "x = 1"], 3, 9),
        (["[world]", "frames = [1, 2", "", ""], 2, 15),
        (["[world]", "# " + "9" * 5000, f"seed = {'9' * 5000}"], 3, 8),
    ],
)
def test_an_error_has_the_offset_of_its_character(lines, line, column, newline):
    text = newline.join(lines)
    with pytest.raises(TomlError) as caught:
        read_toml(text)
    before = text[: caught.value.offset]
    assert (before.count("\n") + 1, len(before.rpartition("\n")[2]) + 1) == (line, column)


def test_dots_in_strings_and_comments_are_no_keys():
    dots = ".".join(["PDot"] * 500)
    text = f'# {dots}\na = "{dots}"\nb = """\n{dots}\n"""\nc = \'{dots}\'\n'
    assert read_toml(text) == {"a": dots, "b": f"{dots}\n", "c": dots}


def test_a_key_of_as_many_parts_as_are_allowed_is_read():
    table = read_toml(".".join(["a"] * MAX_KEY_PARTS) + " = 1")
    assert table == tomllib.loads(".".join(["a"] * MAX_KEY_PARTS) + " = 1")


@given(st.text(alphabet="ab.=[]{}\"'\n# 1e-_", max_size=80))
def test_it_is_the_standard_librarys_toml(text):
    try:
        wanted = tomllib.loads(text)
    except ValueError:
        with pytest.raises(TomlError):
            read_toml(text)
    else:
        assert repr(read_toml(text)) == repr(wanted)


def test_an_option_of_any_content_is_a_text():
    assert toml_value("[" * 100_000) == "[" * 100_000
    assert toml_value("1" * 5000) == "1" * 5000


PARTS = 200_000


@pytest.mark.parametrize(
    "text",
    [
        "a" + ".a" * PARTS + " = 1",
        '"a"' + '."a"' * PARTS + " = 1",
        "'a'" + " . 'a'" * PARTS + " = 1",
        "[a" + ".a" * PARTS + "]",
        "[[a" + ".a" * PARTS + "]]",
        "x = {a" + ".a" * PARTS + " = 1}",
        "x = [{a" + ".a" * PARTS + " = 1}]",
        "x = " + "1" * PARTS,
        "x = " + "1_" * PARTS + "1",
        "x = " + "[" * PARTS,
        "x = " + "{a = " * PARTS,
    ],
    ids=range(11),
)
def test_very_many_parts_digits_or_levels_are_refused_before_they_cost_anything(text):
    with pytest.raises(TomlError):
        read_toml(text)


@given(st.text())
def test_every_text_survives_being_written(text):
    assert read_toml(f"x = {toml_value_text(text)}") == {"x": text}


@pytest.mark.parametrize("text", ["\x7f", "a\x7f\x00\x1f", "\\u007f"])
def test_control_characters_survive_being_written(text):
    assert read_toml(f"x = {toml_value_text(text)}") == {"x": text}


def test_a_key_with_dots_is_of_a_table():
    table = {"qos": {"scan": "reliable"}, "rate": 1}
    values = {"qos.odometry": "volatile", "rate": 2, "new.table.key": True}
    qos = {"scan": "reliable", "odometry": "volatile"}
    assert extended(table, values) == {"qos": qos, "rate": 2, "new": {"table": {"key": True}}}
    assert table["qos"] == {"scan": "reliable"}
    assert extended(table, {"rate.unit": "Hz", ".".join("a" * 100_000): 1})["rate"] == {
        "unit": "Hz"
    }
