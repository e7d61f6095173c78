"""Messages of the page's three-dimensional scene: changes, once each, and removals."""

from collections import Counter

import numpy as np
import pytest
from web_world import (
    FLOOR,
    WORDS,
    PFloor,
    PMemory,
    PStone,
    PWanted,
    PWay,
    cart,
    listened,
    named,
    picture,
    slot,
)

pytest.importorskip("viser")

from minerva_bus.grammar.columns import packed
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_services.geometry.picture import Lists
from minerva_services.views.web.page_scene import Eye, PageScene

WALK = slot("ACart", "c")


@pytest.fixture
def stage():
    with listened() as (server, sent):
        made = PageScene(server)
        sent.clear()
        yield made, sent, server.scene


def names(sent):
    return Counter(type(message).__name__ for message in sent)


def updates(sent):
    """Updated properties by node."""
    updates = {}
    for message in sent:
        if type(message).__name__ == "SceneNodeUpdateMessage":
            updates.setdefault(message.name, set()).update(message.updates)
    return updates


def removed(sent):
    return {message.name for message in sent if type(message).__name__ == "RemoveSceneNodeMessage"}


def test_a_world_is_sent_once_and_then_only_what_has_changed(stage):
    made, sent, _ = stage
    lists, home = Lists(WORDS), PFloor(FLOOR) + named("inn", 1.0, 1.0) + WALK
    made.show(picture(home, lists, c=cart(1.0)))
    assert names(sent)["MeshMessage"] == 2  # ground and walls
    assert names(sent)["LabelMessage"] == 2  # the inn, and the cart's name
    assert names(sent)["BatchedMeshesMessage"] == 3  # bodies, headings, pins
    sent.clear()
    made.show(picture(home, lists, c=cart(1.0)))
    assert not sent
    made.show(picture(home, lists, c=cart(1.5)))
    assert updates(sent) == {
        "/movers/bodies": {"batched_positions"},
        "/movers/headings": {"batched_positions"},
    }
    assert names(sent) == {"SceneNodeUpdateMessage": 2, "SetPositionMessage": 1}  # and its name
    sent.clear()
    made.show(picture(home, lists, c=cart(1.5, turn=90.0)))
    assert updates(sent) == {
        "/movers/bodies": {"batched_wxyzs"},
        "/movers/headings": {"batched_wxyzs"},
    }


def test_missing_items_are_removed(stage):
    made, sent, scene = stage
    full = PFloor(FLOOR) + named("inn", 1.0, 1.0) + WALK + PWay((0.0, 1.0), (0.0, 1.0))
    made.show(picture(full, c=cart(1.0)))
    made.select("c")
    sent.clear()
    made.show(picture(EMPTY))
    gone = {"/movers/bodies", "/movers/headings", "/pins", "/labels/0", "/lines/world/1"}
    assert gone | {"/floor/1/0/ground", "/floor/1/1/walls", "/selected/ring"} <= removed(sent)
    assert scene.get_handle_by_name("/movers/bodies") is None
    made.show(picture(full, c=cart(2.0)))
    assert scene.get_handle_by_name("/movers/bodies") is not None


def test_knowledge_is_sent_when_it_changes(stage):
    made, sent, scene = stage
    lists, before, after = Lists(WORDS), FLOOR.copy(), FLOOR.copy()
    after[0, 0] = 1
    made.show(picture(WALK, lists, c=PMemory(before)))
    node = scene.get_handle_by_name("/knowledge/c/1")
    assert (node.render_width, node.render_height) == (4.0, 3.0)
    assert node.position.tolist()[:2] == [2.0, 1.5]
    sent.clear()
    made.show(picture(WALK, lists, c=PMemory(before) + PStone(0.1)))
    assert "/knowledge/c/1" not in updates(sent)
    made.show(picture(WALK, lists, c=PMemory(after)))
    assert updates(sent)["/knowledge/c/1"] == {"_data"}
    assert "ImageMessage" not in names(sent)


def test_a_floor_without_coloured_cells_may_get_some(stage):
    made, _, scene = stage
    made.show(picture(PFloor(np.full_like(FLOOR, -1))))
    assert scene.get_handle_by_name("/floor/1/0/ground") is None
    made.show(picture(PFloor(FLOOR)))
    assert scene.get_handle_by_name("/floor/1/0/ground") is not None


def test_a_matrix_is_a_picture_with_rows_along_x():
    from minerva_services.views.solids import image

    cells = np.zeros((2, 3), np.int16)
    cells[1, 0] = 1
    (tiles,) = picture(PMemory(cells)).items
    pixels = image(tiles)
    times = pixels.shape[1] // 2
    assert pixels.shape == (3 * times, 2 * times, 4)
    assert pixels[0, -1].tolist() == [0, 0, 255, 128]
    assert pixels[0, 0].tolist()[3] == pixels[-1, -1].tolist()[3] == 0


def test_lines_and_labels_follow(stage):
    made, _, scene = stage
    made.show(picture(WALK, c=PWay((0.0, 1.0), (0.0, 0.0)) + named("inn", 1.0, 2.0)))
    line = scene.get_handle_by_name("/lines/c/1")
    made.show(picture(WALK, c=PWay((0.0, 9.0), (0.0, 0.0)) + named("bar", 3.0, 2.0)))
    assert scene.get_handle_by_name("/lines/c/1") is line
    assert line.points[:, 1, 0].max() == pytest.approx(9.0, abs=0.2)
    label = scene.get_handle_by_name("/labels/0")
    assert (label.text, label.position[0]) == ("bar", 3.0)
    assert made.labels() == ("bar",)
    made.show(picture(WALK, c=PWay((), ())))
    assert scene.get_handle_by_name("/lines/c/1") is None


def test_the_selected_agent_has_a_ring_that_goes_with_it(stage):
    made, _, scene = stage
    both = slot("ACart", "c") + slot("ACart", "d")
    made.show(picture(both, c=cart(1.0), d=cart(4.0)))
    made.select("d")
    ring = scene.get_handle_by_name("/selected/ring")
    assert ring.batched_positions[0][0] == 4.0
    assert [scene.get_handle_by_name(f"/names/{at}").text for at in (0, 1)] == ["c", "d"]
    made.show(picture(both, c=cart(1.0), d=cart(5.0)))
    assert ring.batched_positions[0][0] == 5.0
    made.select("")
    assert scene.get_handle_by_name("/selected/ring") is None
    assert scene.get_handle_by_name("/names/1").text == "d"  # also without the ring


def test_the_ring_is_around_the_disc_that_has_a_heading(stage):
    made, _, scene = stage
    made.show(picture(WALK, c=PStone(0.1) + cart(3.0)))
    made.select("c")
    assert scene.get_handle_by_name("/selected/ring").batched_positions[0][0] == 3.0


def test_ten_thousand_movers_are_two_nodes(stage):
    made, sent, _ = stage
    movers = [
        packed(Scene(tuple(n for i in range(10_000) for n in cart(i + x).nodes))) for x in (0, 1)
    ]
    made.show(picture(movers[0]))
    assert names(sent)["BatchedMeshesMessage"] == 2
    sent.clear()
    made.show(picture(movers[1]))
    assert len(sent) == 2
    made.show(picture(EMPTY))
    assert removed(sent) == {"/movers/bodies", "/movers/headings"}


def test_of_things_over_one_another_the_later_is_on_top(stage):
    made, _, scene = stage
    made.show(picture(PStone(1.0) + PStone(0.5)))
    heights = scene.get_handle_by_name("/movers/bodies").batched_scales[:, 2]
    assert heights[0] < heights[1]


def test_the_camera_is_where_all_is_seen_as_soon_as_there_is_something(stage):
    made, *_ = stage
    camera = made._server.initial_camera
    made.show(picture(WALK))
    before = camera.look_at.tolist()
    made.show(picture(PFloor(FLOOR)))
    assert camera.look_at.tolist() == [2.0, 1.5, 0.0] != before
    made.show(picture(PStone(50.0)))
    assert camera.look_at.tolist() == [2.0, 1.5, 0.0]  # it does not jump


def test_a_thing_without_a_heading_has_its_name_while_it_is_selected(stage):
    made, _, scene = stage
    made.show(picture(WALK, c=PStone(0.1)))
    assert scene.get_handle_by_name("/names/0") is None
    made.select("c")
    assert scene.get_handle_by_name("/names/0").text == "c"
    made.select("")
    assert scene.get_handle_by_name("/names/0") is None


def test_a_marked_label_is_larger_and_its_pin_has_the_colour_of_the_mark(stage):
    made, sent, scene = stage
    inns = named("inn", 1.0, 1.0) + named("bar", 2.0, 1.0)
    lists = Lists(WORDS)
    made.show(picture(inns + WALK, lists, c=cart(1.0)))
    plain = scene.get_handle_by_name("/pins").batched_colors.copy()
    made.show(picture(inns + WALK, lists, c=cart(1.0) + PWanted("bar")))
    colors = scene.get_handle_by_name("/pins").batched_colors
    assert (colors[0] == plain[0]).all()
    assert colors[1].tolist() == [255, 0, 255]
    scales = [scene.get_handle_by_name(f"/labels/{at}").font_screen_scale for at in (0, 1)]
    assert scales[0] == 1.0 < scales[1]
    sent.clear()
    made.show(picture(inns + WALK, lists, c=cart(1.0) + PWanted("bar")))
    assert "/pins" not in updates(sent)


class Camera:
    """A camera of a browser, 10 m above the origin; a page is 8 m high there."""

    position, look_at, up_direction = (0.0, 0.0, 10.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    fov = 2 * np.arctan(0.4)  # A pixel is 1 cm.


def test_a_click_on_a_label_means_what_it_names(stage):
    made, _, _ = stage
    made.show(picture(named("inn", 3.0, 3.0) + WALK, c=cart(-2.0)))
    eye = Eye.of(Camera)

    def clicked(x, y, height):
        """A click `x` and `y` pixels beside the anchor of a label, at a place in metres."""
        depth = 10.0 - height
        place = np.array([*anchor, height]) + depth * 1e-3 * np.array([x, y, 0.0])
        return made.clicked(Camera.position, place - Camera.position, eye)

    anchor, height = made._pins.labels[0].position[:2], made._pins.labels[0].position[2]
    assert clicked(0, 9, height).text == "inn"
    assert clicked(11, 1, height).text == "inn"
    assert clicked(30, 9, height) is None
    assert clicked(0, 30, height) is None
    anchor, height = made._names.shown[0].position[:2], made._names.shown[0].position[2]
    assert clicked(0, 15, height).agent == clicked(0, 15, height).owner == "c"
