"""The paper's robot, ARobot: its evolution function λ (section 4.2.3).

The activities below are the cases of λ, one per event, in the paper's order.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot import errands
from minerva_agents.robot.control import next_move, notice
from minerva_agents.robot.grid import (
    clear_open_beam,
    clearing_part,
    close,
    mark_marker,
    mark_obstacle,
    mark_scan,
)
from minerva_agents.robot.matching import Uncertainty, match
from minerva_agents.robot.pose import (
    STAY,
    GridPose,
    Move,
    Reals,
    action_of,
    at_distance,
    at_distances,
    centre_of,
    move_of,
    wrapped,
)
from minerva_agents.robot.state import RobotState
from minerva_agents.robot.vocabulary import (
    PGoal,
    PGrid,
    PObjective,
    PPath,
    PRobot,
    TPlace,
    eInterrupted,
)
from minerva_bus import (
    EMPTY,
    Context,
    Degrees,
    Event,
    EventBatch,
    Metres,
    Scene,
    on,
    portable,
    view,
)


class ARobot(RobotState, symbol="ARobot", rest=("action",)):
    """A robot that searches for a marker, and transports what stands at one marker to another."""

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
            errands.carry(self, self.pose.after(move, self.cell).position, moment)

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
        errands.carry(self, self.position, moment)
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
        errands.carry(self, self.position, moment)
        self.forget_plan()

    @on("eErrand")
    def set_errand(self, order: Event, moment: Context) -> None:
        """Bring what stands at the source to the target; the objective is suspended."""
        errands.begin(self, order.source, order.target, moment)

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
            errands.notice_rival(self, take.marker, moment)

    @on("eTaken")
    def load_parcel(self, taken: Event, moment: Context) -> None:
        """Add a parcel to the load and pick it up."""
        if taken.sender and taken.sender not in self.load:
            self.load = (*self.load, taken.sender)
            errands.carry(self, self.position, moment)

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
        return known + _path_shown(self) + _objective_shown(self) + robot

    def ends(self, beams: EventBatch | Event) -> tuple[Reals, Reals]:
        """Where n beams end, in cells, (n,) each, from `dist` in metres and `angle` in degrees."""
        angles, dist = self.angle + np.atleast_1d(beams.angle), np.atleast_1d(beams.dist)
        return at_distances(self.row, self.column, angles, dist / self.cell)

    def _stand(self, pose: GridPose) -> None:
        self.row, self.column, self.angle = pose.row, pose.column, pose.angle

    def _act(self, move: Move) -> None:
        # An equal action keeps its string, because comparisons of strings start with identity.
        if move != move_of(self.action):
            self.action = action_of(move, self.id, self.radius)


def filled(dist: Reals, angle: Reals, max_gap: float) -> tuple[Reals, Reals]:
    """The hits, plus points one cell apart between neighbours at most `max_gap` cells apart.

    Distances are cells, angles degrees, (n,) each. A laser with few beams samples a wall sparsely,
    and without interpolation a scan would fit best where its points coincide with those of the
    previous scan. A laser with many beams needs none: interpolation would round off corners.
    """
    cos, sin = portable.cos_sin(np.radians(angle))
    down, right = dist * cos, dist * sin
    far_down, far_right = np.roll(down, -1) - down, np.roll(right, -1) - right
    gaps = portable.hypot(far_down, far_right)
    counts = np.where(gaps <= max_gap, np.maximum(np.ceil(gaps), 1), 1).astype(np.intp)
    which = np.repeat(np.arange(len(dist)), counts)
    firsts = np.cumsum(counts) - counts
    parts = (np.arange(len(which)) - firsts[which]) / counts[which]
    down, right = down[which] + parts * far_down[which], right[which] + parts * far_right[which]
    return portable.hypot(down, right), np.degrees(portable.atan2(right, down))


_MAX_GAP: Final = 0.6
"""Maximum gap in metres between neighbouring hits on one wall."""

_KEY_DEGREES: Final = 30.0
_KEY_METRES: Final = 0.25
"""Degrees and metres after which a scan is drawn. Drawing every matched scan would make the map
follow the robot's errors instead of correcting them."""


class ALocalisingRobot(ARobot, symbol="ALocalisingRobot"):
    """A robot that corrects its pose before it draws what it sees.

    Attributes in addition to ARobot's:
        turned: total rotation since the last drawn scan.
        driven: distance travelled since then.
    """

    turned: Degrees = 0.0
    driven: Metres = 0.0

    # Not part of the state, because these buffers are empty between two frames.
    _hits: tuple[tuple[float, float], ...] = ()
    _misses: tuple[tuple[float, float], ...] = ()

    @on("eLaser", together=True, population=False)
    def sense_obstacle(self, laser: EventBatch | Event, moment: Context) -> None:
        """Buffer (metres, degrees) of hits until the scan is complete, in the same frame."""
        self._hits = (*self._hits, *_beams(laser))

    @on("eClear", together=True, population=False)
    def sense_free(self, beam: EventBatch | Event, moment: Context) -> None:
        """Buffer (metres, degrees) of beams without a hit until the scan is complete."""
        self._misses = (*self._misses, *_beams(beam))

    def sense_marker(self, camera: Event, moment: Context) -> None:
        """g', after the pose is corrected."""
        self._localise(moment)
        super().sense_marker(camera, moment)

    def decide(self, event: Event, moment: Context) -> None:
        """r', c', ang', act', after the pose is corrected."""
        self._localise(moment)
        before = self.pose
        super().decide(event, moment)
        # From this motion follows the uncertainty of the next match.
        self.turned += abs(wrapped(self.angle - before.angle))
        gone = portable.hypot(self.row - before.row, self.column - before.column)
        self.driven += float(gone) * self.cell

    def _localise(self, moment: Context) -> None:
        """Correct the pose by the buffered scan, and draw the scan after enough motion."""
        hits, misses = self._in_cells(self._hits), self._in_cells(self._misses)
        self._hits, self._misses = (), ()
        if not len(hits) and not len(misses):
            return
        # A robot at rest draws every scan at the same pose, which cannot distort the map.
        if self.turned or self.driven:
            self._correct(hits)
            if self.turned < _KEY_DEGREES and self.driven < _KEY_METRES:
                return
            self.turned = self.driven = 0.0
        self._draw(hits, misses, clearing_part(moment.number))

    def _in_cells(self, beams: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
        """(n, 2): distance in cells, angle in degrees."""
        # Without beams, the array would have one dimension only.
        return np.array(beams, np.float64).reshape(-1, 2) / (self.cell, 1.0)

    def _correct(self, hits: NDArray[np.float64]) -> None:
        """Move to the pose at which the hits match the map best.

        Without hits there is no evidence.
        """
        if not len(hits):
            return
        uncertainty = Uncertainty.after(self.turned, self.driven)
        walls = filled(hits[:, 0], hits[:, 1], _MAX_GAP / self.cell)
        best = match(self.grid, self.pose, walls, self.cell, uncertainty)
        self.row, self.column, self.angle = best.row, best.column, wrapped(best.angle)

    def _draw(self, hits: NDArray[np.float64], misses: NDArray[np.float64], part: float) -> None:
        grid, row, column = self.writable("grid"), self.row, self.column
        ends = at_distances(row, column, self.angle + hits[:, 1], hits[:, 0])
        mark_scan(grid, row, column, *ends, part)
        for dist, angle in misses.tolist():
            to = at_distance(row, column, self.angle + angle, dist)
            clear_open_beam(grid, row, column, *to, part)


def _beams(event: EventBatch | Event) -> Iterator[tuple[float, float]]:
    """Distances in metres and angles in degrees."""
    dist, angle = np.atleast_1d(event.dist), np.atleast_1d(event.angle)
    return zip(dist.tolist(), angle.tolist(), strict=True)


def _path_shown(robot: RobotState) -> Scene:
    """The path from the robot's position over the remaining corners; empty without a path."""
    if not robot.plan_rows:
        return EMPTY
    points = [robot.metres(position) for position in (robot.position, *robot.way)]
    return PPath(tuple([x for x, _ in points]), tuple([y for _, y in points]))


def _objective_shown(robot: RobotState) -> Scene:
    """The objective's name, and its place if it is known; empty without an objective."""
    if not robot.objective:
        return EMPTY
    marked, place = PObjective(robot.objective), robot.objective_cell()
    if place is None:
        return marked
    return marked + TPlace(*robot.metres(centre_of(place)))(PGoal())
