"""User input at a page becomes events and orders; each rejection is one line."""

from dataclasses import replace

import numpy as np
import pytest
from web_world import FLOOR, Nobody, PCart, PFloor, PWanted, listened, picture, yard

pytest.importorskip("viser")

from minerva_bus.world.operator import LogEntry, OrderStatus
from minerva_services.views.palette import person_colour
from minerva_services.views.web import html
from minerva_services.views.web.controller import PageController
from minerva_services.views.web.panel import ALL, NOTABLE, EventFeed, Panel
from minerva_services.views.web.picking import Clicked
from tests.patience import eventually


class Stage:
    def __init__(self):
        self.selected, self.known = [], ("inn", "bar")

    def select(self, agent):
        self.selected.append(agent)

    def labels(self):
        return self.known


class Room:
    """A desk with its panel, on a server without a browser."""

    def __init__(self, server, click=""):
        self.operator, self.stage = Nobody(), Stage()
        self.desk = PageController(yard(self.operator), self.stage, click)
        self.panel = Panel(server, "yard", yard().vocabulary, self.desk)
        self.gui = server.gui

    def open(self):
        self.desk.open(self.panel)
        eventually(lambda: len(self.panel._forms) == 3)

    def inputs(self, kind):
        handles = list(self.gui._gui_input_handle_from_uuid.values())
        return {
            handle.label: handle
            for handle in handles
            if type(handle).__name__ == f"Gui{kind}Handle"
        }

    def options(self, label):
        """The options of a dropdown; empty while a form is removed and created again."""
        return getattr(self.inputs("Dropdown").get(label), "options", ())

    def says(self):
        return self.panel._notice.content


@pytest.fixture
def room():
    with listened() as (server, _):
        made = Room(server)
        made.desk.set_agents({"c": "ACart", "d": "ACart", "p": "AParcel"})
        yield made
        made.desk.close()


def test_orders_of_people_are_listed_with_their_fates(room):
    fate = OrderStatus(3, 1, "anna", 'eGo<place="<inn>">', "eGo", "waiting", 4)
    room.operator.fates.append(fate)
    room.open()
    eventually(lambda: "waits for a frame" in room.panel._fates._text.content)
    assert "&lt;inn&gt;" in room.panel._fates._text.content
    assert f"color:{person_colour('anna')}" in room.panel._fates._text.content
    replaced = replace(fate, change=2, state="replaced", by="eGo", frame=6)
    room.operator.fates.append(replaced)
    eventually(lambda: "replaced by eGo in frame 6" in room.panel._fates._text.content)
    assert room.panel._fates._folder.visible


def test_each_order_type_has_a_form_of_its_data(room):
    room.open()
    assert set(room.panel._forms) == {"eGo", "ePace", "eBring"}
    assert room.inputs("Dropdown")["place"].options == ("inn", "bar")
    assert (room.inputs("Dropdown")["source"].value, room.inputs("Dropdown")["target"].value) == (
        "inn",
        "bar",
    )
    assert set(room.inputs("Checkbox")) == {"gently"}
    assert set(room.inputs("Number")) == {"times"}
    assert "speed (m/s)" in room.inputs("Slider")
    room.operator.types = ("eGo",)
    eventually(lambda: set(room.panel._forms) == {"eGo"})
    eventually(lambda: "times" not in room.inputs("Number"))


def test_texts_are_typed_in_until_there_are_labels_to_choose_from(room):
    room.stage.known = ()
    room.open()
    assert set(room.inputs("Text")) == {"place", "source", "target"}
    room.stage.known = ("inn",)
    eventually(lambda: not room.inputs("Text"))
    room.stage.known = ("inn", "den")
    eventually(lambda: room.options("target") == ("inn", "den"))


def test_a_form_sends_its_event_to_the_selected_agent_or_to_all(room):
    room.open()
    form = room.panel._forms["eBring"]
    form._send("eBring", form.data())
    room.desk.select("d")
    form._send("eBring", form.data())
    assert [str(order) for order in room.operator.told] == [
        'eBring<source="inn", target="bar", times=0, gently=false>',
        'eBring<source="inn", target="bar", times=0, gently=false> to #d',
    ]
    assert "eBring(source=inn, target=bar, times=0, gently=false) sent to d" in room.says()
    assert room.stage.selected == ["d"]
    assert room.panel._agent._selected.value == "d"


def test_a_click_selects_an_agent_and_sends_a_text(room):
    room.open()
    room.desk.click(Clicked("c", "c"))
    room.desk.click(Clicked(text="bar"))
    assert [str(order) for order in room.operator.told] == ['eGo<place="bar"> to #c']


def test_a_robot_that_accepts_no_orders_gets_none_and_the_page_shows_it(room):
    room.open()
    room.desk.select("p")
    room.desk.order("eGo", {"place": "inn"})
    assert not room.operator.told
    assert "p does not accept eGo" in room.says()


def test_the_only_one_that_takes_orders_is_selected(room):
    room.desk.set_agents({"c": "ACart", "p": "AParcel"})
    room.open()
    eventually(lambda: room.stage.selected == ["c"])


def test_of_a_slider_only_the_last_place_counts(room):
    room.open()
    for speed in (0.1, 0.2, 0.3):
        room.desk.slide("ePace", {"speed": speed})
    eventually(lambda: room.operator.told and room.operator.told[-1].speed == 0.3)
    assert len(room.operator.told) <= 2


def test_sliders_show_what_the_agent_has(room):
    room.open()
    room.desk.select("c")
    eventually(lambda: room.inputs("Slider")["speed (m/s)"].value == 0.75)
    eventually(lambda: "<b>ACart#c</b>" in room.panel._agent._state.content)
    assert not room.operator.told


def test_pace(room):
    room.open()
    room.desk.pause()
    room.desk.step()
    room.desk.resume()
    room.desk.set_rate(30.0)
    eventually(lambda: room.operator.told == ["pause", "step", "resume", 30.0])


def test_the_header_shows_the_state_of_the_world(room):
    room.open()
    eventually(lambda: "frame 7 · 0.7 s · 9.5 of 10 frames/s" in room.panel._head.content)
    eventually(lambda: room.panel._rate.value == 10.0)
    assert not room.operator.told


def test_a_world_that_does_not_answer_is_a_line_on_the_page(room):
    room.open()
    room.operator.silent = True
    room.desk.pause()
    eventually(lambda: "has not answered" in room.says())
    assert room.desk._thread.is_alive()
    room.operator.unheard = 0
    eventually(lambda: room.operator.unheard)
    room.operator.silent = False
    eventually(lambda: not room.says())


def test_texts_of_the_world_are_no_markup(room):
    room.operator.happenings = (LogEntry(1, 3, "eGo", 'eGo<place="<img src=x>">'),)
    room.open()
    eventually(lambda: "&lt;img src=x&gt;" in room.panel._events.content)
    room.panel.show_error("<b>no</b>")
    assert "<b>no" not in room.says()


def test_long_values_are_cut():
    assert html.summary(np.zeros((182, 122))) == "182 × 122 numbers"
    assert html.summary((1.0,) * 400).startswith("400 values: [1, 1,")
    assert len(html.summary("x" * 4000)) < 50
    assert html.summary(3.46389583683e-14) == "3.4639e-14"


def test_events_of_every_frame_do_not_drown_the_rest():
    feed = EventFeed(yard().vocabulary)
    entries = tuple(
        LogEntry(n, n // 3, "eGo" if n == 5 else "eLaser", f"number {n}") for n in range(1, 200)
    )
    rates = {"eLaser": 900.0, "eGo": 0.1}
    feed.update(replace(Nobody().status(0), happenings=entries, events=rates))
    assert [happening.number for happening in feed.chosen(NOTABLE, 9)] == [5]
    assert [happening.number for happening in feed.chosen(ALL, 3)] == [197, 198, 199]
    assert feed.choices == (NOTABLE, ALL, "eGo", "eLaser")
    assert feed.last == 199


def test_the_legend_shows_what_has_been_drawn_as_text():
    shown = picture(PFloor(FLOOR) + PWanted("inn") + PCart()).legend
    content = html.legend(shown)
    assert [entry.text for entry in shown] == ["cart", "wanted <b>", "floor"]
    assert "wanted &lt;b&gt;" in content
    assert "<b>" not in content
    assert "rgb(255 0 255 / 1)" in content
    assert "rgb(255 255 255 / 1) 0% 50%,rgb(34 34 34 / 1) 50% 100%" in content


def test_the_header_has_the_latest_report(room):
    room.operator.happenings = (LogEntry(1, 3, "eDone", 'eDone<what="tea"> from #c'),)
    room.open()
    eventually(lambda: "c done: tea (0.3 s)" in room.panel._head.content)
