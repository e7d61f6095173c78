"""The robot of the paper, ARobot: its state and its evolution function λ, section 4.2.3.

The activities below are the cases of λ, one for each event, in the paper's order. All that a robot
remembers is in its state, so another process can go on with it from any frame.
"""

from __future__ import annotations

from minerva_agents.robot import deciding, errand
from minerva_agents.robot.ground import Position, room_of
from minerva_agents.robot.knowledge import (
    at_distance,
    clear_beam,
    clear_open_beam,
    close,
    mark_marker,
    mark_obstacle,
    part_that_counts,
    place_of,
)
from minerva_agents.robot.motion import STAY, Move, Pose, action_of, move_of
from minerva_agents.robot.vocabulary import PGoal, PGrid, PPath, PRobot, TPlace
from minerva_bus import (
    EMPTY,
    Agent,
    Cells,
    Context,
    Degrees,
    Event,
    Metres,
    MetresPerSecond,
    Scene,
    Seconds,
    on,
    view,
)


class ARobot(Agent, symbol="ARobot", rest=("action",)):
    """A robot that looks for a marker, and brings what stands at one to another.

    The paper's attributes:
        grid: what is known of the floor, cell by cell; see `knowledge` for the codes.
        row, column: where the robot is in the grid, in cells; it stands in the cell of the floor.
        angle: where it heads, counter-clockwise from the direction in which rows grow.
        speed: how far it goes in a second.
        objective: the marker it is to find, or empty for none; on an errand, where it goes next.
        action: what it carries out in this frame; ε at first.

    What an implementation needs besides:
        cell: the side of a cell.
        x0, y0: where in the world the outer corner of cell (0, 0) lies.
        radius: the robot's own.
        planner: how it decides, see `deciding`.
        markers: the names that the grid's marker codes stand for; a camera's new one is added.
        fov, sight: how wide and how far the robot takes its camera to see.
        plan_rows, plan_columns: the corners still ahead on its way.
        purpose: what the way is for.
        is_narrow: whether the way leads where the robot only just fits, see `narrows`.
        pause: frames for which it still waits.
        failures: how often in a row it has found no way.
        heading: where it turns to for a look, while that is its purpose.
        news: square metres that it hopes to see at the end of its way or turn.
        been: cells that it has gone to for a look in this search, as row * columns + column.
        dull: cells where a turn has shown nothing new, likewise.
        searches: how often it has looked everywhere for this objective, in vain.
        most_known: cells that it knew, and had looked at, at most since it has this objective.
        stale: for how long it has not been more.

    What an errand needs, see `errand`:
        target: where it is to bring what it fetches; empty if it is on no errand.
        later: the objective that the errand has interrupted.
        load: the parcels that it carries.
        waits: frames until all have answered that stand where it asks.
    """

    grid: Cells
    row: float
    column: float
    angle: Degrees = 0.0
    speed: MetresPerSecond = 0.0
    objective: str = ""
    action: Scene = EMPTY

    cell: Metres = 0.1
    x0: Metres = 0.0
    y0: Metres = 0.0
    radius: Metres = 0.18
    planner: str = "astar"
    markers: tuple[str, ...] = ()
    fov: Degrees = 60.0
    sight: Metres = 5.0
    plan_rows: tuple[float, ...] = ()
    plan_columns: tuple[float, ...] = ()
    purpose: str = ""
    is_narrow: bool = False
    pause: int = 0
    failures: int = 0
    heading: Degrees = 0.0
    news: float = 0.0
    been: tuple[int, ...] = ()
    dull: tuple[int, ...] = ()
    searches: int = 0
    most_known: int = 0
    stale: Seconds = 0.0

    target: str = ""
    later: str = ""
    load: tuple[str, ...] = ()
    waits: int = 0

    @on("eLaser")
    def sense_obstacle(self, laser: Event, moment: Context) -> None:
        """g': an obstacle at (r + dist cos(ang + angle), c + dist sin(ang + angle))."""
        grid, dist = self.writable("grid"), laser.dist / self.cell
        row, column = at_distance(self.row, self.column, self.angle + laser.angle, dist)
        part = part_that_counts(moment.number)
        clear_beam(grid, self.row, self.column, row, column, part)
        mark_obstacle(grid, row, column)

    @on("eClear")
    def sense_free(self, beam: Event, moment: Context) -> None:
        """g': no obstacle up to (r + dist cos(ang + angle), c + dist sin(ang + angle))."""
        dist, part = beam.dist / self.cell, part_that_counts(moment.number)
        end = at_distance(self.row, self.column, self.angle + beam.angle, dist)
        clear_open_beam(self.writable("grid"), self.row, self.column, *end, part)

    @on("eCamera")
    def sense_marker(self, camera: Event, moment: Context) -> None:
        """g': a marker at (r + dist cos(ang + angle), c + dist sin(ang + angle))."""
        if camera.marker not in self.markers:
            self.markers = (*self.markers, camera.marker)
        marker, dist = self.markers.index(camera.marker), camera.dist / self.cell
        row, column = at_distance(self.row, self.column, self.angle + camera.angle, dist)
        mark_marker(self.writable("grid"), row, column, marker)

    @on("eDecide")
    def decide(self, event: Event, moment: Context) -> None:
        """r', c', ang', act': where the action of this frame leads, and the one for the next."""
        if not self.action.nodes:
            self.action = action_of(STAY, self.id, self.radius)
            return
        deciding.notice(self)
        moved = move_of(self.action)
        self._stand(self.pose.after(moved, self.cell))
        move = deciding.decide(self, moment)
        self._act(move)
        if moved.dist or move.dist:
            errand.carry(self, self.pose.after(move, self.cell).position, moment)

    @on("eObjective")
    def set_objective(self, order: Event, moment: Context) -> None:
        """o': the marker to find from now on; an errand ends."""
        self.later = ""
        self.seek(order.marker)

    @on("eSpeed")
    def set_speed(self, order: Event, moment: Context) -> None:
        """s': the speed from now on."""
        self.speed = order.speed

    @on("eCollision")
    def collide(self, collision: Event, moment: Context) -> None:
        """Go back by what was not driven, remember the obstacle, make a new plan.

        Physics stopped the move that `decide` has taken for done (section 5).
        """
        back = Move(0.0, -collision.shortfall)
        self._stand(self.pose.after(back, self.cell))
        errand.carry(self, self.position, moment)
        touch = self.radius / self.cell + 0.5
        mark_obstacle(self.writable("grid"), *at_distance(self.row, self.column, self.angle, touch))
        self.forget_plan()

    @on("eRefused")
    def take_refusal(self, refused: Event, moment: Context) -> None:
        """Take the way ahead for closed, and make a new plan.

        A norm has refused the last step, so neither the robot nor its body has gone it.
        """
        touch = self.radius / self.cell + 0.5
        close(self.writable("grid"), *at_distance(self.row, self.column, self.angle, touch))
        errand.carry(self, self.position, moment)
        self.forget_plan()

    @on("eErrand")
    def set_errand(self, order: Event, moment: Context) -> None:
        """Bring what stands at the source to the target; the objective waits."""
        errand.begin(self, order.source, order.target, moment)

    @on("eTake")
    def hear_of_another(self, take: Event, moment: Context) -> None:
        """Another robot takes what stands at a marker."""
        if take.sender != self.id:
            errand.hear_of_another(self, take.marker, moment)

    @on("eTaken")
    def load_parcel(self, taken: Event, moment: Context) -> None:
        """Have one parcel more, and lift it."""
        if taken.sender and taken.sender not in self.load:
            self.load = (*self.load, taken.sender)
            errand.carry(self, self.position, moment)

    @view("eRepresent")
    def represent(self, event: Event) -> Scene:
        """θ: the action, carried out where the robot is."""
        return TPlace(*self.metres(self.position), self.angle)(self.action)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        """θ: the robot, what it knows, its way and where its objective is."""
        known = PGrid(self.grid, self.cell, self.x0, self.y0)
        robot = TPlace(*self.metres(self.position), self.angle)(PRobot(self.id, self.radius))
        return known + self._way_shown() + self._goal_shown() + robot

    @property
    def pose(self) -> Pose:
        """Where the robot is and heads."""
        return Pose(self.row, self.column, self.angle)

    @property
    def position(self) -> Position:
        """Where the robot is, in cells."""
        return self.row, self.column

    @property
    def room(self) -> float:
        """How far it keeps from obstacles, in cells."""
        return room_of(self.radius, self.cell)

    @property
    def way(self) -> list[Position]:
        """The corners that are still ahead."""
        return list(zip(self.plan_rows, self.plan_columns, strict=True))

    def seek(self, objective: str, target: str = "") -> None:
        """Go to another marker, on an errand if there is a target; plan anew."""
        self.objective, self.target, self.waits = objective, target, 0
        self.failures = self.searches = self.most_known = 0
        self.stale = 0.0
        self.been = self.dull = ()
        self.forget_plan()

    def set_way(self, way: list[Position], purpose: str, is_narrow: bool = False) -> None:
        """Have another way."""
        self.is_narrow = is_narrow
        self.plan_rows = tuple([row for row, _ in way])
        self.plan_columns = tuple([column for _, column in way])
        self.purpose = purpose

    def forget_plan(self) -> None:
        """Have no way any more."""
        self.set_way([], "")

    def objective_cell(self) -> tuple[int, int] | None:
        """Where the objective's marker is, or None while it has not been seen."""
        if self.objective not in self.markers:
            return None
        return place_of(self.grid, self.markers.index(self.objective))

    def metres(self, position: Position) -> Position:
        """A position of the grid in metres of the world."""
        return self.x0 + position[0] * self.cell, self.y0 + position[1] * self.cell

    def _stand(self, pose: Pose) -> None:
        self.row, self.column, self.angle = pose.row, pose.column, pose.angle

    def _act(self, move: Move) -> None:
        if move != move_of(self.action):
            self.action = action_of(move, self.id, self.radius)

    def _way_shown(self) -> Scene:
        if not self.plan_rows:
            return EMPTY
        points = [self.metres(one) for one in (self.position, *self.way)]
        return PPath(tuple([x for x, _ in points]), tuple([y for _, y in points]))

    def _goal_shown(self) -> Scene:
        place = self.objective_cell() if self.objective else None
        if place is None:
            return EMPTY
        return TPlace(*self.metres((place[0] + 0.5, place[1] + 0.5)))(PGoal())
