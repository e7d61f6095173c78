"""Norms in world files: [norm.NAME], read strictly."""

import pytest
from street import eFine

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log.entries import plain_norm, read_norms
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.wire.plain import DEFAULT
from minerva_bus.wire.strings_codec import Reader
from minerva_bus.world.norms import Norm, Then

WORLD = """
[world]
string = "ARunner#a · ALight#light"
vocabulary = "street:vocabulary"

[options]
most = 3
strict = true

[process.runners]
agents = ["street:One", "street:Light", "street:Passer"]

[process.steps]
service = "street:Steps"

"""


def read(folder, text, **options):
    path = folder / "street.toml"
    path.write_text(WORLD + text, encoding="utf-8")
    return read_world_file(path, Overrides(options=options))


def norms_of(folder, text, **options):
    return read(folder, text, **options).world.norms


def test_every_key(tmp_path):
    text = """
[norm.limit]
applies = "ARunner"
when = "speed > 14 and was.speed < 14 or #light.green == false"
where = [8, 1, 2.5, 3]
most = "${most}"
per = 10
then = "sanction"
event = "eFine"
data = { amount = 30 }

[norm.quiet]
applies = ["ARunner", "steps", "people", "people:anna"]
on = ["eShout", "eStep"]
when = "event.loud > 1"
in_force = "${strict}"
"""
    limit, quiet = norms_of(tmp_path, text)
    assert limit == Norm(
        "limit",
        ("ARunner",),
        when="speed > 14 and was.speed < 14 or #light.green == false",
        where="x >= 2.5 and x <= 8.0 and y >= 1.0 and y <= 3.0",
        most=3,
        per=10,
        then=Then.SANCTION,
        sanction=eFine(30, "limit"),
    )
    assert quiet == Norm(
        "quiet",
        ("ARunner", "steps", "~order", "~order:anna"),
        ("eShout", "eStep"),
        when="event.loud > 1",
    )
    assert norms_of(tmp_path, text, most="5", strict="false")[0].most == 5
    assert len(norms_of(tmp_path, text, strict="false")) == 1


def test_a_record_has_them(tmp_path):
    world = read(tmp_path, '[norm.a]\nwhen = "x > 1"\nevent = "eFine"\ndata = { amount = 1 }').world
    plain = [plain_norm(norm) for norm in world.norms]
    assert read_norms(plain, Reader(world.vocabulary, DEFAULT)) == world.norms


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "norm.n.when is missing"),
        ('when = "speeed > 1"', r"street.toml:17: norm.n.when:1:1: ARunner has no speeed; did you"),
        ('applies = "ARunner"\nwhen = "x > 1 and"', r"street.toml:18: norm.n.when:1:10: the cond"),
        (
            'applies = "ALight"\nwhen = "green > 1"',
            "green of ALight is true or false, which cannot",
        ),
        ('when = "x > 1 and z > 2"', "norm.n.when:1:11: ARunner has no z"),
        ('when = "green == true"\nwhere = "x > 1"', "norm.n.where:1:1: ALight has no x"),
        ('when = "event.loud > 1"', "has no event.loud"),
        ('when = "was.green == true and x > 1"', "has no"),
        ('when = "#lamp.green == true"', "has no #lamp.green; did you mean '#light.green'"),
        ('when = "#light.red == true"', "has no #light.red"),
        ('on = "eShout"\nwhen = "event.lout > 1"', "ALight with eShout has no event.lout; did you"),
        ('on = "eShout"\nwhen = "was.x > 1"', "has no was.x"),
        ('on = "eShut"', "street.toml:17:1: norm.n.on has the unknown event type eShut; did you"),
        (
            'applies = "ARunnr"\nwhen = "x > 1"',
            "unknown agent kind or process ARunnr; did you mean",
        ),
        ('applies = "steps"\nwhen = "x > 1"', "names steps, which is not an agent"),
        ('when = "x > 1"\nthen = "forbid"', "norm.n.then must be one of refuse, sanction, count"),
        (
            'when = "x > 1"\nthen = "sanction"',
            "norm.n.then is a sanction: `event` must name its event",
        ),
        ('when = "x > 1"\nthen = "count"\nevent = "eFine"', "norm.n.event is sent only if"),
        ('when = "x > 1"\nevent = "eFin"', "norm.n.event is unknown: eFin; did you mean 'eFine'"),
        (
            'when = "x > 1"\nevent = "eFine"',
            "norm.n.event is wrong: eFine needs a value for amount",
        ),
        (
            'when = "x > 1"\nevent = "eFine"\ndata = { amount = "much" }',
            "street.toml:19:1: norm.n.data is wrong: eFine: amount must be",
        ),
        ('when = "x > 1"\ndata = { amount = 1 }', "norm.n.data is for an event"),
        ("where = [1, 2, 3]", "must be a condition, or the corners"),
        ('where = [1, 2, "x", 3]', "must be a condition, or the corners"),
        ("where = [0, 0, 1, nan]", "must be a condition, or the corners"),
        (f"where = [0, 0, 1, {10**400}]", "must be a condition, or the corners"),
        ("where = 3", "norm.n.where must be a text"),
        ('when = "x > 1"\nmost = -1', "norm.n.most must be at least 0"),
        ('when = "x > 1"\nper = 0', "norm.n.per must be at least 1"),
        (
            'when = "x > 1"\nwhenn = "x > 1"',
            "norm.n.whenn is unknown; did you mean 'when'",
        ),
        ('when = "x > 1"\nin_force = 1', "norm.n.in_force must be true or false"),
    ],
)
def test_errors_are_reported_with_their_position(tmp_path, text, message):
    with pytest.raises(WorldFileError, match=message) as caught:
        norms_of(tmp_path, f"[norm.n]\n{text}\n")
    assert "street.toml" in str(caught.value)
