"""Errands, 4.1: robots and parcels coordinate by events, and each parcel is in one place."""

import math

import pytest
from errands import Story, centre, parcel, robot

from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.vocabulary import eCollision, eErrand, eObjective, ePicture, ePut, eTake
from minerva_agents.robot.world import vocabulary
from minerva_bus import evolve, visualize

BRING = eErrand("office", "store")


def near(parcel, marker):
    return parcel.marker == marker and math.dist((parcel.x, parcel.y), centre(marker)) < 0.4


def on(parcel, robot):
    """Whether a parcel lies on a robot, within its rim."""
    place = robot.metres(robot.position)
    return parcel.carrier == robot.id and math.dist((parcel.x, parcel.y), place) < 0.1


# --- one robot ----------------------------------------------------------------------------------


@pytest.mark.parametrize("planner", ["astar", "random"])
def test_a_parcel_moves_from_source_to_target(planner):
    story = Story(robot(planner=planner), parcel()).step(BRING)
    assert story.until("eDelivered").marker == "store"
    assert near(story.parcel(), "store")
    assert story.parcel().carrier == ""
    assert story.robot().load == ()
    assert story.types() == [
        ("r1", "eTake"), ("p1", "eTaken"), ("r1", "ePut"), ("r1", "eDelivered"),
    ]  # fmt: skip


def test_all_bodies_on_the_platform_move_along_and_no_others():
    story = Story(
        robot(), parcel("a", side=-90.0), parcel("b", side=-40.0), parcel("c", marker="lab")
    )
    story.step(BRING).until("eTaken")
    story.step()
    assert story.robot().load == ("a", "b")
    story.until("eDelivered")
    assert near(story.parcel("a"), "store")
    assert near(story.parcel("b"), "store")
    assert near(story.parcel("c"), "lab")
    places = [(story.parcel(name).x, story.parcel(name).y) for name in "ab"]
    assert math.dist(*places) > 0.1


def test_a_carried_parcel_is_on_its_robot_in_every_frame():
    story = Story(robot(), parcel()).step(BRING)
    story.until("eTaken")
    story.step().step()
    frames = 0
    while story.robot().load:
        assert on(story.parcel(), story.robot())
        assert story.parcel().marker == ""
        story.step()
        frames += 1
    assert frames > 20


def test_a_collision_takes_the_load_back_too():
    story = Story(robot(), parcel()).step(BRING)
    story.until("eTaken")
    for _ in range(12):
        story.step()
    story.step(eCollision(0.05)).step()
    assert on(story.parcel(), story.robot())


def test_an_errand_interrupts_the_objective_and_sends_no_reached():
    story = Story(robot(objective="lab"), parcel()).step(BRING)
    assert (story.robot().objective, story.robot().later) == ("office", "lab")
    story.until("eDelivered")
    assert (story.robot().objective, story.robot().target, story.robot().later) == ("lab", "", "")
    assert (story.robot().purpose, story.types("eReached")) == ("", [])
    assert story.until("eReached").marker == "lab"


def test_without_an_objective_it_is_idle_again_and_makes_way():
    story = Story(robot(), parcel()).step(BRING)
    story.until("eDelivered")
    assert (story.robot().objective, story.robot().purpose) == ("", "make way")


def test_it_gives_up_at_an_empty_place_and_continues():
    story = Story(robot(objective="lab"), parcel(marker="store")).step(BRING)
    given_up = story.until("eGivenUp")
    assert given_up.data == {"source": "office", "target": "store", "why": "nothing stands there"}
    assert (story.robot().objective, story.robot().target) == ("lab", "")
    assert story.until("eReached").marker == "lab"
    assert near(story.parcel(), "store")


@pytest.mark.parametrize(
    ("source", "target", "why"),
    [
        ("cellar", "store", "there is no marker 'cellar'"),
        ("office", "cellar", "there is no marker 'cellar'"),
        ("office", "office", "source and target are the same"),
    ],
)
def test_an_errand_that_makes_no_sense_changes_nothing(source, target, why):
    scene = robot(objective="lab")
    story = Story(scene, parcel()).step()
    before = story.robot()
    story.step(eErrand(source, target))
    assert [event.data["why"] for event in story.coming] == [why]
    now = story.robot()
    assert (now.objective, now.target, now.way) == ("lab", "", before.way)


def test_a_marker_that_it_has_not_seen_is_looked_for():
    story = Story(robot(), parcel()).step(eErrand("attic", "store")).step()
    assert (story.robot().objective, story.types()) == ("attic", [])
    assert story.robot().purpose in ("search", "look", "")


# --- the last order counts ----------------------------------------------------------------------


def test_an_objective_on_the_way_to_the_source_ends_the_errand():
    story = Story(robot(objective="lab"), parcel()).step(BRING).step()
    story.step(eObjective("store"))
    assert (story.robot().objective, story.robot().target, story.robot().later) == ("store", "", "")
    assert story.until("eReached").marker == "store"
    assert near(story.parcel(), "office")
    assert story.types("eTake", "eDelivered", "eGivenUp") == []


def test_a_loaded_robot_takes_its_load_along_and_puts_it_down_at_its_objective():
    story = Story(robot(), parcel()).step(BRING)
    story.until("eTaken")
    for _ in range(10):
        story.step()
    story.step(eObjective("lab"))
    assert story.robot().load == ("p1",)
    assert story.until("eReached").marker == "lab"
    assert near(story.parcel(), "lab")
    assert story.types("eDelivered") == []


def test_a_new_errand_takes_the_place_of_the_old_one_with_its_load():
    story = Story(robot(objective="attic"), parcel("a"), parcel("b", marker="lab")).step(BRING)
    story.until("eTaken")
    for _ in range(10):
        story.step()
    story.step(eErrand("lab", "store"))
    assert story.robot().later == "attic"
    story.until("eDelivered")
    assert near(story.parcel("a"), "store")
    assert near(story.parcel("b"), "store")
    assert story.robot().objective == "attic"


def test_an_order_between_question_and_answer_loses_no_parcel():
    story = Story(robot(), parcel()).step(BRING)
    story.until("eTake")
    story.step(eObjective("lab"))
    story.until("eReached")
    assert near(story.parcel(), "lab")
    assert story.robot().load == ()


# --- several robots -----------------------------------------------------------------------------


def test_of_two_that_ask_at_once_exactly_one_gets_it():
    first, other = robot("r1", row=7.5, column=10.5), robot("r2", row=13.5, column=10.5)
    story = Story(first, other, parcel()).step(BRING).step()
    assert story.types("eTake") == [("r1", "eTake"), ("r2", "eTake")]
    assert story.until("eGivenUp").sender == "r2"
    assert (story.robot("r1").load, story.robot("r2").load) == (("p1",), ())
    assert story.parcel().carrier == "r1"
    story.until("eDelivered")
    assert near(story.parcel(), "store")
    assert story.types("eTaken", "eDelivered") == [("p1", "eTaken"), ("r1", "eDelivered")]


def test_a_robot_that_learns_it_is_second_turns_back_at_once():
    near_by, far = robot("r1", row=20.5, column=10.5), robot("r2", row=40.5, objective="lab")
    story = Story(near_by, far, parcel()).step(BRING)
    story.until("eTake")
    story.step()
    assert [(event.sender, event.data.get("why")) for event in story.coming] == [
        ("r2", "another robot has come first"), ("p1", None),
    ]  # fmt: skip
    assert story.robot("r2").objective == "lab"


def test_an_errand_elsewhere_is_not_disturbed():
    first, other = robot("r1", row=14.5, column=10.5), robot("r2")
    story = Story(first, other, parcel("a"), parcel("b", marker="lab"))
    story.step(
        eErrand("office", "store", receivers=["r1"]), eErrand("lab", "store", receivers=["r2"])
    )
    story.until("eTake")
    for _ in range(250):
        story.step()
    assert story.types("eGivenUp") == []
    assert near(story.parcel("a"), "store")
    assert near(story.parcel("b"), "store")


def test_the_load_of_a_deleted_robot_stays_until_moved():
    story = Story(robot("r1"), robot("r2", row=40.5), parcel()).step(
        eErrand("office", "store", receivers=["r1"])
    )
    story.until("eTaken")
    for _ in range(15):
        story.step()
    story.without("r1")
    there = story.step().parcel()
    story.step(eErrand("office", "lab", receivers=["r2"]))
    assert story.until("eGivenUp").why == "nothing stands there"
    assert (story.parcel().x, story.parcel().y, story.parcel().carrier) == (there.x, there.y, "r1")
    story.step(ePut("office", *centre("office"), receivers=["p1"]))
    story.step(eErrand("office", "lab", receivers=["r2"]))
    story.until("eDelivered")
    assert near(story.parcel(), "lab")


# --- parcels ------------------------------------------------------------------------------------


def parcel_after(*events, **state):
    scene = AParcel("p", **({"x": 1.0, "y": 2.0, "marker": "office"} | state)).string
    done = evolve(scene, events, [AParcel])
    return AParcel.thaw(done.scene.nodes[0]), done.emitted.get("p", ())


def test_a_parcel_goes_to_the_first_agent_that_asks():
    asked = [eTake("office", sender="r2"), eTake("office", sender="r1")]
    now, said = parcel_after(*asked)
    assert (now.marker, now.carrier) == ("", "r2")
    assert [(event.type, event.receivers) for event in said] == [("eTaken", ("r2",))]


@pytest.mark.parametrize(
    ("event", "state"),
    [
        (eTake("store", sender="r1"), {}),
        (eTake("office"), {}),
        (eTake("", sender="r1"), {"marker": ""}),
        (eTake("office", sender="r1"), {"marker": "", "carrier": "r2"}),
        (vocabulary.events["eCarry"](5.0, 5.0, sender="r1"), {}),
        (vocabulary.events["eCarry"](5.0, 5.0, sender="r1"), {"marker": "", "carrier": "r2"}),
        (ePut("lab", 5.0, 5.0, sender="r1"), {"marker": "", "carrier": "r2"}),
        (ePut("lab", 5.0, 5.0, sender="r1"), {}),
    ],
)
def test_other_odometry_does_not_move_a_robot(event, state):
    before, _ = parcel_after(**state)
    now, said = parcel_after(event, **state)
    assert (now.string, said) == (before.string, ())


def test_its_picture_is_where_it_is():
    shown = visualize(AParcel("p", x=1.0, y=2.0).string, [ePicture()], [AParcel])
    assert str(vocabulary.check(shown)) == "TPlace<x=1, y=2, angle=0>(PParcel<radius=0.11>)"


def test_an_errand_goes_through_its_text():
    story = Story(robot(objective="lab"), parcel("a"), parcel("b")).step(BRING)
    story.until("eTaken")
    story.step()
    assert story.robot().load == ("a", "b")
    assert vocabulary.read(str(story.scene)) == story.scene
