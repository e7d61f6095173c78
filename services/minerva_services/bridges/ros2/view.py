"""RViz as a view of the world: a robot's map, path and objective, and clickable goals."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.appearance import Label, Shape
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import NetworkLink, Ros2Session, TopicPublisher
from minerva_services.bridges.ros2.qos import DEFAULT, LASTING
from minerva_services.bridges.ros2.uses import NetworkUser, TopicUse, topic_uses
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.ros_messages.readings import place_of
from minerva_services.bridging.bridge import Counting, log
from minerva_services.options import names_in, takes_options

Cells = NDArray[np.int16]
_BEAT_SECONDS: Final = 0.25


class MapPicture(PlaneGeometry):
    """The parts of a picture that RViz can show.

      PGrid   a robot's map: 0 unknown, 1 free, 2-9 obstacle, 10 and above free
      PPath   its planned path
      PGoal   where it assumes its objective

    Labels of all kinds are named places.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.grids: list[tuple[Cells, float, Pose]] = []
        self.ways: list[list[Pose]] = []
        self.goals: list[Pose] = []
        self.places: dict[str, Pose] = {}

    def PGrid(self, cells: Cells, cell: float, x: float, y: float) -> None:
        """α: an occupancy grid with its corner at (x, y)."""
        self.grids.append((cells, cell, self._here().compose(Pose(x, y))))

    def PPath(self, xs: tuple[float, ...], ys: tuple[float, ...]) -> None:
        """α: a path through these points."""
        here = self._here()
        self.ways.append([here.compose(Pose(x, y)) for x, y in zip(xs, ys, strict=True)])

    def PGoal(self, **_: object) -> None:
        """α: a goal."""
        self.goals.append(self._here())

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        """α of a label: a place."""
        if isinstance(shape, Label):
            self.places[str(figure.parameters[shape.text])] = self._here()

    def _here(self) -> Pose:
        return Pose(self.pose.x, self.pose.y, self.pose.angle)


def occupancy(cells: Cells) -> NDArray[np.int8]:
    """Cells [along x, along y] as OccupancyGrid data: by y, -1, 0 or 100."""
    walls = (cells >= 2) & (cells <= 9)
    values = np.where(cells == 0, -1, np.where(walls, 100, 0))
    return np.ascontiguousarray(values.T, np.int8).ravel()


def nearest_place(places: dict[str, Pose], goal: Pose, radius: float) -> str:
    """The name of the place nearest to a goal, the first among equals. Raises MisuseError."""
    ordered = sorted(
        (portable.hypot(at.x - goal.x, at.y - goal.y), name) for name, at in places.items()
    )
    if not ordered or ordered[0][0] > radius:
        near = f"; the nearest is {ordered[0][1]}, {ordered[0][0]:.1f} m away" if ordered else ""
        raise MisuseError(
            f"no marker within {radius:g} m of the goal ({goal.x:.2f}, {goal.y:.2f}){near}"
        )
    return ordered[0][1]


class Ros2View(Device, Counting, NetworkUser, draws=("ePicture",)):
    """Publishes a robot's knowledge for RViz, and turns a clicked goal into an objective.

    World coordinates are those of the map frame. A goal stands for the marker nearest to it.

    Args:
        router: the endpoint of the robot's network; its other options are those of `Ros2Network`.
        robot: the id of the agent; optional if there is only one.
        map: topic of the OccupancyGrid messages.
        plan: topic of the Path messages.
        objective: topic of PoseStamped messages: where the robot assumes its objective.
        goal: topic of PoseStamped messages; each is an order. "": accepts no goals.
        radius: maximum distance in metres from a goal to its marker.
        event: the type of the order, whose `marker` is the marker's name.
        frame: the map frame.
        every: frames between pictures.
        qos: the quality of service of topics, by option: {plan = "best_effort"}.

    """

    source_option: ClassVar[str] = "router"

    @takes_options(Ros2Network)
    def __init__(
        self,
        router: str,
        robot: str = "",
        map: str = "map",
        plan: str = "plan",
        objective: str = "objective",
        goal: str = "goal_pose",
        radius: float = 2.0,
        event: str = "eObjective",
        frame: str = "map",
        every: int = 10,
        qos: Mapping[str, Any] | None = None,
        **network: Any,
    ) -> None:
        Counting.__init__(self)
        self.network = Ros2Network(router, **network)
        # RViz may start later than the world, and need not be there at all; for maps it expects a
        # transient local publisher.
        out = {
            "map": (map, types.GRID, LASTING), "plan": (plan, types.PATH, DEFAULT),
            "objective": (objective, types.POSE_STAMPED, DEFAULT),
        }  # fmt: skip
        uses = [
            TopicUse(option, topic, message, sends=True, qos=usual, needed=False)
            for option, (topic, message, usual) in out.items()
        ]
        uses.append(TopicUse("goal", goal, types.POSE_STAMPED, needed=False))
        self.uses = topic_uses(self.network, uses, qos)
        # Each objective that is published would come back as an order.
        if goal and goal == objective:
            raise MisuseError("ros2_view: goal and objective must be different topics")
        self._robot, self._radius = robot, radius
        self.concerns = names_in(robot)
        self._event, self._frame = event, frame
        self.when = f"each {every} frames" if every else ""
        self._link = NetworkLink(
            self.network, "minerva_view", self._declare, lambda: None, _BEAT_SECONDS, self.uses
        )
        self._publishers: dict[str, TopicPublisher] = {}
        self._picture: MapPicture | None = None

    def check(self, world: WorldInfo) -> list[str]:
        """What fits no robot. Raises MisuseError if rosbags is missing."""
        messages()
        return self.unfit()

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        self._world = world
        self._link.start()

    def show(self, view: View) -> None:
        """Publish φ of the picture on the declared topics."""
        picture = MapPicture(self._world.vocabulary)
        interpret(view.scene, picture)
        own = self._of_robot(view, picture)
        with self._lock:
            self._picture = picture
            # A new link replaces the publishers in its own thread.
            publishers = dict(self._publishers)
        header = messages().header(self._frame, time.time_ns())
        if types.GRID in publishers and own.grids:
            publishers[types.GRID].put(_grid_message(header, *own.grids[0]))
        if types.PATH in publishers:
            # An empty path is sent as well: it removes the previous one from RViz.
            way = own.ways[0] if own.ways else []
            publishers[types.PATH].put(_path_message(header, way))
        if types.POSE_STAMPED in publishers and own.goals:
            publishers[types.POSE_STAMPED].put(_pose_message(header, own.goals[0]))

    def report(self) -> dict[str, bool | int | float | str]:
        """State of the link, and the number of goals that became orders."""
        return {**self.counts, "source": self._link.state}

    def close(self) -> None:
        """Leave the network."""
        self._link.close()

    def _of_robot(self, view: View, picture: MapPicture) -> MapPicture:
        part: Scene | None = view.parts.get(self._robot) if self._robot else None
        if part is None:
            return picture
        own = MapPicture(self._world.vocabulary)
        interpret(part, own)
        return own

    def _declare(self, session: Ros2Session) -> None:
        publishers = dict[str, TopicPublisher]()
        for use in self.uses:
            if use.sends:
                publishers[use.message] = session.publisher(use.topic, use.message, use.qos)
            else:
                session.subscribe(use.topic, use.message, self._on_goal, use.qos)
        with self._lock:
            self._publishers = publishers

    def _on_goal(self, data: bytes) -> None:
        """Turn a goal into an order, or log why it is ignored."""
        try:
            message = messages().decode(types.POSE_STAMPED, data)
            goal = Pose(*place_of(message.pose))
        except GarbageError as error:
            self.pass_over("garbage", f"ros2_view: {error}; goal ignored")
            return
        with self._lock:
            # Goals arrive in a thread of Zenoh, pictures in that of the world.
            places = dict(self._picture.places) if self._picture is not None else {}
        try:
            if message.header.frame_id.strip("/") != self._frame:
                raise MisuseError(f"a goal in {message.header.frame_id!r}, not in {self._frame!r}")
            marker = nearest_place(places, goal, self._radius)
            declared = self._world.vocabulary.events[self._event]
            receivers = [self._robot] if self._robot else []
            self._world.operator.order(declared(marker=marker, receivers=receivers))
        except (MinervaError, KeyError) as error:
            log(f"ros2_view: {error}; goal ignored")
        else:
            self.count("goals")


def _grid_message(header: Any, cells: Cells, cell: float, corner: Pose) -> Any:
    make = messages()
    about = make.make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=header.stamp, resolution=cell,
        width=cells.shape[0], height=cells.shape[1],
        origin=make.pose(corner.x, corner.y, corner.angle),
    )  # fmt: skip
    return make.make(types.GRID, header=header, info=about, data=occupancy(cells))


def _path_message(header: Any, way: list[Pose]) -> Any:
    poses = [_pose_message(header, pose) for pose in way]
    return messages().make(types.PATH, header=header, poses=poses)


def _pose_message(header: Any, at: Pose) -> Any:
    pose = messages().pose(at.x, at.y, at.angle)
    return messages().make(types.POSE_STAMPED, header=header, pose=pose)
