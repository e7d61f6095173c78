"""The paper's robot, ARobot: its state and its evolution function λ (section 4.2.3).

The activities below are the cases of λ, one per event, in the paper's order. All memory is in the
agent's state, so another process can continue it from any frame.
"""

from __future__ import annotations

import numpy as np

from minerva_agents.robot import errand
from minerva_agents.robot.deciding import next_move, notice
from minerva_agents.robot.ground import room_of
from minerva_agents.robot.knowledge import (
    clear_open_beam,
    clearing_part,
    close,
    mark_marker,
    mark_obstacle,
    place_of,
)
from minerva_agents.robot.motion import (
    STAY,
    GridPose,
    Move,
    Position,
    Reals,
    action_of,
    at_distance,
    at_distances,
    move_of,
)
from minerva_agents.robot.patience import begin_search
from minerva_agents.robot.scans import mark_scan
from minerva_agents.robot.showing import goal_shown, way_shown
from minerva_agents.robot.vocabulary import PGrid, PRobot, TPlace, eInterrupted
from minerva_bus import (
    EMPTY,
    Agent,
    Cells,
    Context,
    Degrees,
    Event,
    EventBatch,
    Metres,
    MetresPerSecond,
    Scene,
    Seconds,
    on,
    view,
)


class ARobot(Agent, symbol="ARobot", rest=("action",)):
    """A robot that searches for a marker, and transports what stands at one marker to another.

    Attributes of the paper:
        grid: the evidence grid; see `knowledge` for the cell codes.
        row, column: position in the grid, in cells.
        angle: heading, counter-clockwise from the direction of growing rows.
        speed: driving speed.
        objective: marker to find, or empty; on an errand, the next stop.
        action: what it executes in this frame; initially ε.

    Attributes of this implementation:
        cell: side of a cell.
        x0, y0: world position of the outer corner of cell (0, 0).
        radius: radius of the robot's body.
        planner: decision algorithm, see `deciding`.
        markers: names of the grid's marker codes; newly seen markers are appended.
        fov, sight: field of view and range that the robot assumes for its camera.
        plan_rows, plan_columns: remaining corners of its path.
        purpose: what the path is for.
        is_narrow: whether the path has minimal clearance, see `narrows`.
        pause: frames left to wait.
        failures: consecutive failures to find a path.
        heading: target heading of a look, while that is the purpose.
        news: area in m² expected to be seen at the end of the path or turn.
        been: viewpoints visited in this search, as row * columns + column.
        dull: cells where a turn revealed nothing new, likewise.
        searches: how often the search for this objective was exhausted.
        most_known: maximum number of known or inspected cells in this search.
        stale: time of a search that news have not paid for, or of an approach, see `patience`.

    Attributes of an errand, see `errand`:
        target: destination of the load; empty without an errand.
        later: the objective that the errand interrupted.
        load: parcels on board.
        waits: frames until all parcels at the source have answered.
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

    @on("eLaser", together=True, population=False)
    def sense_obstacle(self, laser: EventBatch | Event, moment: Context) -> None:
        """g': obstacles at (r + dist cos(ang + angle), c + dist sin(ang + angle)), in order."""
        grid, part = self.writable("grid"), clearing_part(moment.number)
        mark_scan(grid, self.row, self.column, *self.ends(laser), part)

    @on("eClear", together=True, population=False)
    def sense_free(self, beam: EventBatch | Event, moment: Context) -> None:
        """g': no obstacle up to (r + dist cos(ang + angle), c + dist sin(ang + angle))."""
        grid, part = self.writable("grid"), clearing_part(moment.number)
        rows, columns = self.ends(beam)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            clear_open_beam(grid, self.row, self.column, row, column, part)

    @on("eCamera")
    def sense_marker(self, camera: Event, moment: Context) -> None:
        """g': a marker at (r + dist cos(ang + angle), c + dist sin(ang + angle))."""
        if camera.marker not in self.markers:
            self.markers = (*self.markers, camera.marker)
        if camera.marker == self.objective and self.objective_cell() is None:
            self.stale = 0.0  # The approach begins, with full patience.
        marker, dist = self.markers.index(camera.marker), camera.dist / self.cell
        row, column = at_distance(self.row, self.column, self.angle + camera.angle, dist)
        mark_marker(self.writable("grid"), row, column, marker)

    @on("eDecide")
    def decide(self, event: Event, moment: Context) -> None:
        """r', c', ang', act': the pose after this frame's action, and the next action."""
        # ε, the initial action (4.2.4): nothing has been executed, so the pose stays.
        if not self.action.nodes:
            self.action = action_of(STAY, self.id, self.radius)
            return
        # Before the move: this frame's image was taken from the present pose.
        notice(self)
        # The view of this frame shows the current action, and the body executes it before the
        # events of the next frame. So the pose moves by it now: the next scan is taken from the new
        # pose.
        moved = move_of(self.action)
        self._stand(self.pose.after(moved, self.cell))
        move = next_move(self, moment)
        self._act(move)
        # eCarry takes effect in the next frame, when the robot will have executed `move`.
        if moved.dist or move.dist:
            errand.carry(self, self.pose.after(move, self.cell).position, moment)

    @on("eObjective")
    def set_objective(self, order: Event, moment: Context) -> None:
        """o': the marker to find from now on; ends an errand."""
        self.later = ""
        self.seek(order.marker)

    @on("eSpeed")
    def set_speed(self, order: Event, moment: Context) -> None:
        """s': the new speed."""
        self.speed = order.speed

    @on("eCollision")
    def collide(self, collision: Event, moment: Context) -> None:
        """Move back by the distance not driven, mark the obstacle and drop the plan.

        Physics stopped the move that `decide` had assumed to be complete (section 5).
        """
        back = Move(0.0, -collision.shortfall)
        self._stand(self.pose.after(back, self.cell))
        errand.carry(self, self.position, moment)
        # Half a cell beyond the body lies in the obstacle's cell.
        touch = self.radius / self.cell + 0.5
        mark_obstacle(self.writable("grid"), *at_distance(self.row, self.column, self.angle, touch))
        self.forget_plan()

    @on("eRefused")
    def take_rejection(self, refused: Event, moment: Context) -> None:
        """Close the cells ahead and drop the plan.

        A norm rejected the last step, so neither the robot nor its body has moved.
        """
        touch = self.radius / self.cell + 0.5
        close(self.writable("grid"), *at_distance(self.row, self.column, self.angle, touch))
        errand.carry(self, self.position, moment)
        self.forget_plan()

    @on("eErrand")
    def set_errand(self, order: Event, moment: Context) -> None:
        """Bring what stands at the source to the target; the objective is suspended."""
        errand.begin(self, order.source, order.target, moment)

    @on("eInterrupt")
    def interrupt(self, order: Event, moment: Context) -> None:
        """o': no objective and no errand; the robot stops and keeps its load."""
        moment.emit(eInterrupted(self.objective))
        self.later = ""
        self.seek("")

    @on("eTake")
    def notice_rival(self, take: Event, moment: Context) -> None:
        """Another robot takes what stands at a marker."""
        # The robot's own request reaches it as well.
        if take.sender != self.id:
            errand.notice_rival(self, take.marker, moment)

    @on("eTaken")
    def load_parcel(self, taken: Event, moment: Context) -> None:
        """Add a parcel to the load and pick it up."""
        if taken.sender and taken.sender not in self.load:
            self.load = (*self.load, taken.sender)
            errand.carry(self, self.position, moment)

    @view("eRepresent")
    def represent(self, event: Event) -> Scene:
        """θ: the action, executed at the robot's pose."""
        return TPlace(*self.metres(self.position), self.angle)(self.action)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        """θ: the robot, its grid, its path and its objective."""
        known = PGrid(self.grid, self.cell, self.x0, self.y0)
        robot = TPlace(*self.metres(self.position), self.angle)(PRobot(self.id, self.radius))
        # In drawing order, with the robot on top.
        return known + way_shown(self) + goal_shown(self) + robot

    @property
    def pose(self) -> GridPose:
        """Position in cells and heading in degrees."""
        return GridPose(self.row, self.column, self.angle)

    @property
    def position(self) -> Position:
        """Position in cells."""
        return self.row, self.column

    @property
    def room(self) -> float:
        """Clearance that the robot keeps from obstacles, in cells."""
        return room_of(self.radius, self.cell)

    @property
    def way(self) -> list[Position]:
        """The remaining corners of the path."""
        return list(zip(self.plan_rows, self.plan_columns, strict=True))

    def seek(self, objective: str, target: str = "") -> None:
        """Start towards another marker, on an errand if there is a target, without a plan."""
        self.objective, self.target, self.waits = objective, target, 0
        begin_search(self)
        self.forget_plan()

    def set_way(self, way: list[Position], purpose: str, is_narrow: bool = False) -> None:
        """Replace the path."""
        self.is_narrow = is_narrow
        self.plan_rows = tuple([row for row, _ in way])
        self.plan_columns = tuple([column for _, column in way])
        self.purpose = purpose

    def forget_plan(self) -> None:
        """Drop the path."""
        self.set_way([], "")

    def objective_cell(self) -> tuple[int, int] | None:
        """The cell of the objective's marker, or None if it has not been seen."""
        if self.objective not in self.markers:
            return None
        return place_of(self.grid, self.markers.index(self.objective))

    def ends(self, beams: EventBatch | Event) -> tuple[Reals, Reals]:
        """Where n beams end, in cells, (n,) each, from `dist` in metres and `angle` in degrees."""
        angles, dist = self.angle + np.atleast_1d(beams.angle), np.atleast_1d(beams.dist)
        return at_distances(self.row, self.column, angles, dist / self.cell)

    def metres(self, position: Position) -> Position:
        """A grid position in metres of the world."""
        return self.x0 + position[0] * self.cell, self.y0 + position[1] * self.cell

    def _stand(self, pose: GridPose) -> None:
        self.row, self.column, self.angle = pose.row, pose.column, pose.angle

    def _act(self, move: Move) -> None:
        # An equal action keeps its string, because comparisons of strings start with identity.
        if move != move_of(self.action):
            self.action = action_of(move, self.id, self.radius)
