"""The device: the files it writes, when it writes them, and its errors."""

import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from svg_world import WORLD, PBall, PRobot, TMove, elements, pixels, view

from minerva_bus import Device, MinervaError
from minerva_services.views.svg import Svg


def joined(path: Path, **options: object) -> Svg:
    made = Svg(str(path), **options)  # type: ignore[arg-type]
    made.joined(WORLD)
    return made


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def test_a_view_becomes_an_svg_and_a_png(tmp_path: Path):
    device = joined(tmp_path / "deep" / "world.svg", width=400)
    device.show(view(30, PRobot()))
    assert names(tmp_path / "deep") == ["world.png", "world.svg"]
    document = (tmp_path / "deep" / "world.svg").read_text()
    root = ElementTree.fromstring(document)
    height, width, _ = pixels((tmp_path / "deep" / "world.png").read_bytes()).shape
    assert (root.attrib["width"], root.attrib["height"]) == (str(width), str(height))
    assert "orchard" in document
    assert "frame 30" in document
    assert device.report() == {
        "picture": str(tmp_path / "deep" / "world.png"),
        "picture_as_svg": str(tmp_path / "deep" / "world.svg"),
    }


def test_a_picture_does_not_depend_on_the_machine(tmp_path: Path):
    joined(tmp_path / "w.svg").show(view(1, PRobot()))
    for name in names(tmp_path):
        assert str(tmp_path).encode() not in (tmp_path / name).read_bytes()


def test_it_asks_for_its_views_itself():
    device = Svg()
    assert isinstance(device, Device)
    assert (device.draws, device.when, device.coupled) == (("ePicture",), "each 10 frames", False)
    assert Svg(draws="eA, eB,eA").draws == ("eA", "eB")
    assert Svg.draws == ("ePicture",)


def test_a_picture_replaces_the_one_before_in_one_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    device = joined(tmp_path / "w.svg", png=False)
    device.show(view(1, PRobot()))
    before = (tmp_path / "w.svg").read_bytes()
    seen: list[bytes] = []
    replace = Path.replace

    def watched(self: Path, target: Path) -> Path:
        seen.append(target.read_bytes())
        ElementTree.fromstring(self.read_bytes())
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", watched)
    device.show(view(2, PBall(0.2)))
    assert seen == [before]
    assert names(tmp_path) == ["w.svg"]
    assert "#123456" in (tmp_path / "w.svg").read_text()


def test_a_failure_leaves_the_picture_before_and_no_draft(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    device = joined(tmp_path / "w.svg", png=False)
    device.show(view(1, PRobot()))
    before = (tmp_path / "w.svg").read_bytes()

    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(MinervaError, match="No space left on device") as caught:
        device.show(view(2, PBall(0.2)))
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == ["w.svg"]
    assert (tmp_path / "w.svg").read_bytes() == before


def test_frames_keeps_every_picture(tmp_path: Path):
    device = joined(tmp_path / "w.svg", frames=True, png=False)
    for frame in (0, 10, 1234567):
        device.show(view(frame, PRobot()))
    assert names(tmp_path) == ["w-000000.svg", "w-000010.svg", "w-1234567.svg"]
    assert device.report() == {"picture": str(tmp_path / "w-1234567.svg")}


def test_without_resvg_the_svg_is_written_and_one_line_reports_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.delitem(sys.modules, "minerva_services.views.svg.rendering", raising=False)
    monkeypatch.setitem(sys.modules, "resvg_py", None)
    device = joined(tmp_path / "w.svg")
    for frame in (1, 2):
        device.show(view(frame, PRobot()))
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install 'minerva-bus[picture]'" in said
    assert names(tmp_path) == ["w.svg"]
    assert device.report() == {"picture": str(tmp_path / "w.svg")}


def test_without_png_resvg_is_not_even_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "resvg_py", None)
    joined(tmp_path / "w.svg", png=False).show(view(1, PRobot()))
    assert capsys.readouterr().err == ""


def test_views_of_several_types_lie_over_one_another(tmp_path: Path):
    device = joined(tmp_path / "w.svg", png=False, draws="ePicture,eOverlay")
    device.show(view(1, TMove(1.0)(PBall(0.5)), "eOverlay"))
    device.show(view(1, PRobot(), "ePicture"))
    fills = [e.attrib["fill"] for e in elements((tmp_path / "w.svg").read_text(), "circle")]
    assert fills == ["#e07a2f", "#123456"]
    before = (tmp_path / "w.svg").read_text()
    device.show(view(2, PRobot(), "ePicture"))
    assert (tmp_path / "w.svg").read_text() == before  # not yet the other view of frame 2


def test_a_folder_that_cannot_be_made_is_a_clear_error(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MinervaError, match="cannot write") as caught:
        joined(tmp_path / "file" / "w.svg")
    assert "\n" not in str(caught.value)


def test_a_picture_where_a_folder_is_is_a_clear_error(tmp_path: Path):
    (tmp_path / "w.svg").mkdir()
    with pytest.raises(MinervaError, match="cannot write"):
        joined(tmp_path / "w.svg", png=False)
    assert names(tmp_path) == ["w.svg"]


def test_neither_picture_overwrites_a_users_file(tmp_path: Path):
    (tmp_path / "plan.png").write_bytes(b"drawn by hand")
    with pytest.raises(MinervaError, match=r"plan\.png exists"):
        joined(tmp_path / "plan.svg")
    joined(tmp_path / "plan.svg", png=False).show(view(1, PRobot()))
    assert (tmp_path / "plan.png").read_bytes() == b"drawn by hand"


def test_a_numbered_picture_does_not_overwrite_a_users_file(tmp_path: Path):
    (tmp_path / "w-000001.svg").write_bytes(b"drawn by hand")
    device = joined(tmp_path / "w.svg", frames=True, png=False)
    with pytest.raises(MinervaError, match=r"w-000001\.svg exists"):
        device.show(view(1, PRobot()))


@pytest.mark.parametrize(
    "options",
    [
        {"path": "w.png"}, {"path": ""}, {"path": ".svg"}, {"every": -1},
        {"width": 0}, {"width": 1_000_000}, {"draws": " , "},
    ],
)  # fmt: skip
def test_options_that_make_no_sense_are_refused(options: dict[str, object]):
    with pytest.raises(MinervaError, match=r"picture: .* expected"):
        Svg(**options)  # type: ignore[arg-type]


def test_it_starts_at_once_only_in_a_world():
    with pytest.raises(MinervaError, match="before the world was joined"):
        Svg().show(view(1, PRobot()))
