"""A rover: people order where it goes, and a robot that navigates by itself drives there."""

from typing import Literal

from minerva_bus import (
    Agent,
    Context,
    Default,
    Degrees,
    Disc,
    Event,
    EventType,
    Metres,
    Motion,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)

PRover = Primitive("PRover", Disc(0.2, "#5b8db8", meaning="the robot"))
PGoal = Primitive("PGoal", Disc(0.1, "#d4622a", meaning="where it goes"), number=int)
TPlace = Transformation(
    "TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0.0)
)

End = Literal["reached", "aborted", "canceled", "rejected", "replaced", "lost"]
eGoal = EventType("eGoal", replaces=("eGoal",), x=Metres, y=Metres, angle=Default(Degrees, 0.0))
eCancel = EventType("eCancel")
eGoalFeedback = EventType("eGoalFeedback", number=int, at_x=Metres, at_y=Metres, distance=Metres)
eGoalResult = EventType("eGoalResult", number=int, end=End, why=str)
eArrived = EventType("eArrived", completes=eGoal)
eNotArrived = EventType("eNotArrived", fails=eGoal, why=str)
eCanceled = EventType("eCanceled", completes=eCancel, fails=eGoal)
ePicture = EventType("ePicture", visual=True)


class Rover(Agent, symbol="ARover"):
    """Shows its goal while it has one; `number` counts the goals."""

    x: Metres = 0.0
    y: Metres = 0.0
    number: int = 0
    goes: bool = False
    goal_x: Metres = 0.0
    goal_y: Metres = 0.0
    goal_angle: Degrees = 0.0

    @on("eGoal")
    def order(self, goal: Event, moment: Context) -> None:
        self.number, self.goes = self.number + 1, True
        self.goal_x, self.goal_y, self.goal_angle = goal.x, goal.y, goal.angle

    @on("eCancel")
    def cancel(self, order: Event, moment: Context) -> None:
        self.goes = False
        moment.emit(eCanceled())

    @on("eGoalFeedback")
    def drive(self, feedback: Event, moment: Context) -> None:
        self.x, self.y = feedback.at_x, feedback.at_y

    @on("eGoalResult")
    def end(self, result: Event, moment: Context) -> None:
        if self.goes and result.number == self.number:
            self.goes = False
            reached = result.end == "reached"
            why = f"{result.end}: {result.why}"
            moment.emit(eArrived() if reached else eNotArrived(why=why))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        robot = TPlace(self.x, self.y)(PRover())
        goal = TPlace(self.goal_x, self.goal_y, self.goal_angle)(PGoal(self.number))
        return robot + goal if self.goes else robot


vocabulary = Vocabulary.of(
    *(PRover, PGoal, TPlace, eGoal, eCancel, eGoalFeedback, eGoalResult),
    *(eArrived, eNotArrived, eCanceled, ePicture, Rover),
)
