"""The JSON Schema of world files agrees with their reader."""

import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from minerva_authoring.world_schema import world_schema
from minerva_bus.errors import MisuseError
from minerva_bus.settings.kinds import settings_of
from minerva_bus.settings.world_settings import TABLES

ROOT = Path(__file__).parents[3]
FILES = sorted({*ROOT.glob("worlds/*/*/*.toml"), *ROOT.glob("agents/*/*/*.toml")})
# A world may have other files beside it, such as the answers of a script.
WORLDS = [path for path in FILES if "[world]" in path.read_text(encoding="utf-8")]
SCHEMA = Draft202012Validator(world_schema())
# No 0.0: an integer in JSON Schema, but not in TOML.
VALUES = (
    *(True, False, 0, 1, -1, 7, 1000, 1001, 2**63, 0.01, 0.5, -0.5, "", "x", "wait"),
    *("count", "literal", "json", "127.0.0.1:9464", [], ["x"], ["x", "y"], [1], {}, {"x": 1}),
)


def errors(text):
    return [error.message for error in SCHEMA.iter_errors(tomllib.loads(text))]


def test_it_is_a_schema():
    Draft202012Validator.check_schema(world_schema())


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.stem)
def test_shipped_worlds_are_valid(path):
    assert errors(path.read_text(encoding="utf-8")) == []


MINIMAL = "[world]\nvocabulary = 'a:b'\n"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("[world]\nseed = 1", "'vocabulary' is a required property"),
        (MINIMAL + "fames = 3", "'fames' was unexpected"),
        (MINIMAL + "frames = 'x'", "'x' is not valid"),
        (MINIMAL + "[process.a]\nevery = 1", "is not valid under any of the given schemas"),
        (MINIMAL + "[procces.a]\nservice = 'each'", "'procces' was unexpected"),
        (MINIMAL + "[limits]\nmessages = 'many'", "'many' is not of type 'integer'"),
        (MINIMAL + "[log]\nformat = 'xml'", "'xml' is not valid"),
        (MINIMAL + "record = { files = 'x' }", "is not valid"),
    ],
)
def test_mistakes_are_found(text, part):
    assert any(part in message for message in errors(text)), errors(text)


@pytest.mark.parametrize(
    "text",
    [
        MINIMAL + "frames = '${n}'\nrecord = { file = 'x.mcap', topics = true }",
        MINIMAL + "[process.a]\nservice = 'x:Y'\nanything = [1, 2]\nlate = 'skip'",
        MINIMAL + "[placement]\nagents_per_host = 3\nAFox = { only = ['a*'], near = 'b' }",
        MINIMAL + "[norm.a]\nwhere = [0, 0, 1, 1]\ndata = { amount = 3.0 }",
    ],
)
def test_correct_files_are_accepted(text):
    assert errors(text) == []


@pytest.mark.parametrize("cls", TABLES, ids=lambda cls: cls.__name__)
def test_a_setting_accepts_the_same_values_as_its_schema(cls):
    for setting in settings_of(cls).values():
        if not setting.kind.schema:
            continue
        validator = Draft202012Validator(setting.kind.schema)
        for value in VALUES:
            try:
                setting.kind.convert(value)
            except MisuseError:
                # A schema cannot express the forms of addresses and names.
                rejected = not isinstance(value, str) or "enum" in setting.kind.schema
                assert not (rejected and validator.is_valid(value)), (setting.name, value)
            else:
                assert validator.is_valid(value), (setting.name, value)
