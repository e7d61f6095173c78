"""The state of a robot, and what its decisions read of it and change in it.

All memory is in the agent's state, so another process can continue it from any frame.
"""

from __future__ import annotations

from minerva_agents.robot.clearance import room_of
from minerva_agents.robot.grid import place_of
from minerva_agents.robot.pose import GridPose, Position
from minerva_bus import EMPTY, Agent, Cells, Degrees, Metres, MetresPerSecond, Scene, Seconds


class RobotState(Agent):
    """What a robot knows, wants and plans; `ARobot` adds its evolution function λ.

    Attributes of the paper:
        grid: the evidence grid; see `grid` for the cell codes.
        row, column: position in the grid, in cells.
        angle: heading, counter-clockwise from the direction of growing rows.
        speed: driving speed.
        objective: marker to find, or empty; on an errand, the next stop.
        action: what it executes in this frame; initially ε.

    Attributes of this implementation:
        cell: side of a cell.
        x0, y0: world position of the outer corner of cell (0, 0).
        radius: radius of the robot's body.
        planner: decision algorithm, see `control`.
        markers: names of the grid's marker codes; newly seen markers are appended.
        fov, sight: field of view and range that the robot assumes for its camera.
        plan_rows, plan_columns: remaining corners of its path.
        purpose: what the path is for.
        is_narrow: whether the path has minimal clearance, see `clearance`.
        pause: frames left to wait.
        failures: consecutive failures to find a path.
        heading: target heading of a look, while that is the purpose.
        news: area in m² expected to be seen at the end of the path or turn.
        been: viewpoints visited in this search, as row * columns + column.
        dull: cells where a turn revealed nothing new, likewise.
        searches: how often the search for this objective was exhausted.
        most_known: maximum number of known or inspected cells in this search.
        stale: time of a search that news have not paid for, or of an approach, see `approach`.

    Attributes of an errand, see `errands`:
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
        self.failures = self.searches = self.most_known = 0
        self.stale = 0.0
        self.been = self.dull = ()
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

    def metres(self, position: Position) -> Position:
        """A grid position in metres of the world."""
        return self.x0 + position[0] * self.cell, self.y0 + position[1] * self.cell

    def in_cells(self, x: float, y: float) -> Position:
        """A place of the world, in metres, as a grid position."""
        return (x - self.x0) / self.cell, (y - self.y0) / self.cell
