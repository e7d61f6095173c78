"""Cameras in space, declared by the symbols of a vocabulary, and the service that renders them.

    PCamera = Primitive("PCamera", Camera(640, 480, fov=60, rate=10))

A camera is a figure within its agent's view, at the place of its mount: x points into the picture,
z up. The service `cameras` renders the view of the frame before by the code of the view `opengl`,
and publishes the pictures as readings, as a real camera's driver does.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import CAMERA
from minerva_bodies.geometry import SpaceGeometry, value_of
from minerva_bodies.rigid import Rigid
from minerva_bus import portable
from minerva_bus.grammar.appearance import Disc, Measure
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.readings import Image, Mount, Odometry
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.geometry.picture import (
    Copies,
    Discs,
    Floats,
    Item,
    Lists,
    Picture,
    Tiles,
    geometry_in_space,
)
from minerva_services.options import check_owner, require

if TYPE_CHECKING:
    from minerva_bodies.ros2 import RosNode

MAX_PIXELS: Final = 8 << 20
"""Pixels of a picture, at most; software renders about a million in a second."""
_NEAR, _FAR = 0.05, 200.0
"""Depths between which things are seen, metres."""


def Camera(
    width: Measure = 640,
    height: Measure = 480,
    *,
    fov: Measure = 60.0,
    rate: Measure = 0.0,
    depth: bool = False,
    color: str = "#222222",
    meaning: str = "",
) -> Disc:
    """A camera without distortion, whose optical axis meets the middle of the picture.

    Its readings are colour images, and with `depth` also images of depths: metres along the optical
    axis, infinite where nothing is.

    Args:
        width: of a picture, pixels.
        height: of a picture, pixels; pixels are squares.
        fov: angle from its left to its right edge, degrees.
        rate: pictures in a simulated second; 0: one of each view.
        depth: whether it also measures depths.
        color: of its mark in the plane.
        meaning: text of the legend.

    """
    spatial = (CAMERA, width, height, fov, rate, float(depth))
    return Disc(0.05, color, height=0.05, meaning=meaning, spatial=spatial)


def focal_length(width: float, fov: float) -> float:
    """The focal length in pixels of a picture so many pixels wide that shows `fov` degrees."""
    return width / 2 / math.tan(math.radians(fov) / 2)


class CarriedCamera(NamedTuple):
    """A camera that a view shows.

    Attributes:
        owner: id of its agent.
        symbol: of the figure.
        body: pose of the agent.
        mount: pose of the camera on it.
        width: of a picture, pixels.
        height: likewise.
        fov: degrees from the left to the right edge.
        rate: pictures per second; 0: of each view.
        depth: whether it measures depths.

    """

    owner: str
    symbol: str
    body: Rigid
    mount: Rigid
    width: int
    height: int
    fov: float
    rate: float
    depth: bool

    def is_due(self, frame: int, dt: float) -> bool:
        """Whether it takes a picture in a frame."""
        every = max(1, round(1.0 / (self.rate * dt))) if self.rate else 1
        return frame % every == 0


class CameraGeometry(SpaceGeometry):
    """The cameras of a view, in the order of the string; other figures mean nothing to it."""

    def _clear(self) -> None:
        super()._clear()
        self.cameras = list[CarriedCamera]()

    def other_figure(self, figure: FigureNode) -> None:
        primitive = self._vocabulary.primitives.get(figure.symbol)
        spatial = primitive.shape.spatial if primitive is not None and primitive.shape else ()
        if not spatial or spatial[0] != CAMERA:
            return
        owner = str(figure.parameters.get(self._who, "")) or self._owner
        if not owner or owner.startswith("~"):
            raise BodiesError(
                f"{figure.symbol}: a camera has no agent; put it in the view of an agent, and in"
                f" that of a population within a transformation with a text parameter {self._who}"
            )
        values = [value_of(measure, figure, owner) for measure in spatial[1:]]
        for measure, value in zip(spatial[1:], values, strict=True):
            if not isinstance(value, float):
                raise BodiesError(
                    f"agent {owner}, {figure.symbol}: {measure} is {value!r:.40}; expected a number"
                )
        carried = self._base is not None
        body, mount = (self._base or Rigid(), self._inner) if carried else (self.pose, Rigid())
        self.cameras.append(_checked(owner, figure.symbol, body, mount, *values))

    def many(self, columns: Columns) -> bool:
        """Pass over the columns of other figures."""
        *_, inner = columns.levels()
        primitive = self._vocabulary.primitives.get(inner.symbol)
        spatial = primitive.shape.spatial if primitive is not None and primitive.shape else ()
        return not spatial or spatial[0] != CAMERA


def _checked(
    owner: str,
    symbol: str,
    body: Rigid,
    mount: Rigid,
    width: float,
    height: float,
    fov: float,
    rate: float,
    depth: float,
) -> CarriedCamera:
    """A camera whose pictures can be taken. Raises BodiesError."""
    where, whole = f"agent {owner}, {symbol}", width == int(width) and height == int(height)
    if not (whole and min(width, height) >= 1 and width * height <= MAX_PIXELS):
        raise BodiesError(
            f"{where}: pictures of {width:g} x {height:g} pixels; expected whole numbers from 1,"
            f" and {MAX_PIXELS} pixels at most, such as 640 x 480"
        )
    if not 1.0 <= fov <= 170.0:
        raise BodiesError(f"{where}: fov is {fov:g}; expected 1 to 170 degrees, such as 60")
    if not 0.0 <= rate < math.inf:
        raise BodiesError(
            f"{where}: rate is {rate:g}; expected pictures per second, or 0 for one of each view"
        )
    return CarriedCamera(
        owner, symbol, body, mount, int(width), int(height), fov, rate, bool(depth)
    )


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera at a pose that looks along x; `focal` is in pixels."""

    pose: Rigid
    width: int
    height: int
    focal: float

    @property
    def eye(self) -> Floats:
        """Position in metres, (3,)."""
        return np.array([self.pose.x, self.pose.y, self.pose.z])

    def metre(self, height: int) -> float:
        """Pixels per metre at a distance of one metre."""
        return self.focal

    def matrix(self, aspect: float) -> Floats:
        """From (x, y, z, 1) to OpenGL's clip coordinates, (4, 4)."""
        from minerva_services.views.opengl.camera import perspective

        turned = self.pose.turned
        axes = np.array([turned(0.0, -1.0, 0.0), turned(0.0, 0.0, 1.0), turned(1.0, 0.0, 0.0)])
        slopes = self.width / 2 / self.focal, self.height / 2 / self.focal
        return perspective(axes, self.eye, slopes, (_NEAR, _FAR))


class Darkroom:
    """Renders pictures of one scene after another, without a window.

    Raises MisuseError if there is no driver.
    """

    def __init__(self) -> None:
        from minerva_services.views.opengl.canvas import RenderTarget, without_window
        from minerva_services.views.opengl.gl_scene import GLScene

        self._gl = without_window()
        self._target = RenderTarget(self._gl, (1, 1))
        self._scene = GLScene(self._gl)
        self._things: tuple[Item, ...] = ()

    def take(self, picture: Picture) -> None:
        """Set the scene: solids, discs and matrices, which are things; texts and lines are not."""
        from minerva_services.views.opengl.extent import extent_of

        # What an agent knows is drawn for people, and is nowhere in its world.
        items = tuple(
            item
            for item in picture.items
            if isinstance(item, Copies | Discs) or (isinstance(item, Tiles) and not item.owner)
        )
        # Often only cameras have moved, and shadows take half as long as a picture.
        if len(items) == len(self._things) and all(map(_looks_same, items, self._things)):
            return
        self._things, things = items, Picture(items)
        with self._gl:
            # Not of former pictures: a successor, which has seen none, renders the same pixels.
            self._scene.take(things, extent_of(things))
            self._scene.shadows(Pinhole(Rigid(), 1, 1, 1.0), (1, 1))

    def colors(self, lens: Pinhole) -> bytes:
        """Rows of pixels from the top, red, green and blue."""
        with self._gl:
            self._draw(lens, smooth=True)
            return self._target.pixels().tobytes()

    def depths(self, lens: Pinhole) -> bytes:
        """Rows of depths from the top, float32 in metres; infinite where nothing is."""
        with self._gl:
            self._draw(lens, smooth=False)
            seen = self._target.depths().astype(np.float64)
        # The inverse of the projection, in which 0 is the nearest and 1 the farthest depth.
        metres = _NEAR * _FAR / (_FAR - seen * (_FAR - _NEAR))
        return np.where(seen < 1.0, metres, np.inf).astype("<f4").tobytes()

    def _draw(self, lens: Pinhole, *, smooth: bool) -> None:
        size = lens.width, lens.height
        if size != self._target.size:
            self._target.resize(size)
        self._target.begin(smooth=smooth)
        # No ray meets the ground around a picture, so it has no depth either.
        self._scene.draw(lens, size, surroundings=smooth)
        self._target.finish()

    def close(self) -> None:
        """Free the memory."""
        self._gl.release()


def _looks_same(first: Item, second: Item) -> bool:
    """Whether two items of pictures look the same, whatever their names."""
    if type(first) is not type(second):
        return False
    pairs = zip(_seen(first), _seen(second), strict=True)
    return all(a is b or np.array_equal(a, b) for a, b in pairs)


def _seen(item: Any) -> list[Any]:
    unseen = "names", "owners"
    return [getattr(item, each.name) for each in fields(item) if each.name not in unseen]


class Cameras(Device, Generator, coupled=True):
    """Publishes what the cameras of agents see as `Image` readings.

    A picture shows the view of the frame before, from where the string has the camera. Software
    renders it if there is no graphics card.

    Args:
        draws: the visual event type of the views.
        images: topic of colour images, in the encoding rgb8.
        depths: topic of images of depths, in the encoding 32FC1: float32, metres.
        camera: symbol of the cameras; "": all. An agent with several needs a service for each.
        poses: topic of `Odometry` that says where agents are, as `rovers` publishes it, if the
            string has them where they believe to be; "": none.
        every: frames between views.
        who: name of the parameter with the id of a camera's agent.
        ros2: the options of `Ros2Network`, to send the pictures to a network of ROS 2, too.

    """

    def __init__(
        self,
        draws: str = "eBodies",
        images: str = "image",
        depths: str = "depth",
        camera: str = "",
        poses: str = "",
        every: int = 1,
        who: str = "who",
        ros2: Mapping[str, Any] | None = None,
    ) -> None:
        require("cameras", "moderngl", "moderngl", "opengl")
        if not 1 <= every <= 100_000:
            raise BodiesError(f"cameras: every is {every}; expected frames from 1 to 100000")
        self.when = f"each {every} frames"
        self.draws, self.publishes = (draws,), tuple(filter(None, (images, depths)))
        self.topics = (poses,) if poses else ()
        self._images, self._depths, self._symbol, self._who = images, depths, camera, who
        self._node: RosNode | None = None
        if ros2 is not None:
            from minerva_bodies.ros2 import RosNode  # It needs the extra ros.

            self._node = RosNode("cameras", ros2)
        self._view: View | None = None
        self._darkroom: Darkroom | None = None
        self._pictures, self._seconds = 0, 0.0

    def check(self, world: WorldInfo) -> None:
        check_owner("cameras", world, self._who)
        known = _symbols(world.vocabulary)
        if self._symbol and self._symbol not in known:
            raise BodiesError(
                f"cameras: {self._symbol} is no camera of the vocabulary; expected"
                f" {', '.join(known) or 'a primitive with the form Camera'}"
            )

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        self._vocabulary, self._dt = world.vocabulary, world.dt
        self._lists = Lists(world.vocabulary, geometry_in_space(world))
        if self._node is not None:
            self._node.open()

    def show(self, view: View) -> None:
        """φ of the view: where the cameras are."""
        space = CameraGeometry(self._vocabulary, who=self._who)
        space.read(view)
        cameras = [each for each in space.cameras if self._symbol in ("", each.symbol)]
        twice = {each.owner for each in cameras}
        for each in cameras:
            if each.owner not in twice:
                raise BodiesError(
                    f"agent {each.owner}, {each.symbol}: the agent has another camera; give each a"
                    " service of its own with the options camera and images"
                )
            twice.discard(each.owner)
        # A member that lacks a driver when it joins is restarted, one that fails in a frame is not.
        self._darkroom = self._darkroom or Darkroom()
        self._view, self._cameras = view, cameras

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        """Publish a picture of each camera that is due; none before the first view."""
        view, darkroom = self._view, self._darkroom
        # A successor gets the last view again, which may be older.
        if view is None or darkroom is None or view.frame != tick.number - 1:
            return ()
        begun = time.perf_counter()
        where = dict[str, Odometry]()
        for reading in tick.readings:
            if not isinstance(reading, Odometry):
                raise BodiesError(
                    f"cameras: expected odometry on {self.topics[0]!r},"
                    f" found {type(reading).__name__}"
                )
            where[reading.robot] = reading
        for camera in self._cameras:
            if camera.is_due(view.frame, self._dt):
                darkroom.take(self._lists.picture(view.skeleton, view.parts))
                self._publish(camera, where.get(camera.owner), darkroom, tick)
        self._seconds += time.perf_counter() - begun
        return ()

    def _publish(
        self, camera: CarriedCamera, known: Odometry | None, darkroom: Darkroom, tick: Tick
    ) -> None:
        body, taken_at = camera.body, (tick.number - 1) * tick.dt
        if known is not None:
            body, taken_at = Rigid.euler(known.x, known.y, body.z, known.angle), known.time
        width, height = camera.width, camera.height
        lens = Pinhole(body.then(camera.mount), width, height, focal_length(width, camera.fov))
        taken = [(self._images, "rgb8", darkroom.colors)]
        if camera.depth:
            taken.append((self._depths, "32FC1", darkroom.depths))
        for topic, encoding, pixels in taken:
            if topic:
                mount = _mount(camera.mount)
                data = pixels(lens)
                image = Image(camera.owner, data, encoding, width, height, taken_at, mount)
                tick.publish(topic, image)
                self._send(image, camera, lens)
                self._pictures += 1

    def _send(self, image: Image, camera: CarriedCamera, lens: Pinhole) -> None:
        """Send a picture to the network of ROS 2, if there is one."""
        if self._node is None:
            return
        from minerva_bodies.ros2 import name_of, optical, pictured

        parent, frame = name_of(camera.owner), f"{name_of(camera.owner, camera.symbol)}_optical"
        self._node.place(parent, frame, optical(camera.mount))
        self._node.send_fixed(round(image.time * 1e9))
        self._node.send(pictured(image, camera.symbol, lens.focal))

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Number of pictures, and the mean duration of rendering each."""
        milliseconds = 1e3 * self._seconds / max(1, self._pictures)
        sent = {} if self._node is None else {"ros2": self._node.state}
        return {"pictures": self._pictures, "picture_ms": round(milliseconds, 1), **sent}

    def close(self) -> None:
        """Free the memory of the graphics card, and leave the network."""
        if self._darkroom is not None:
            self._darkroom.close()
            self._darkroom = None
        if self._node is not None:
            self._node.close()


def _symbols(vocabulary: Vocabulary) -> list[str]:
    """The primitives that are cameras."""
    return [
        name
        for name, each in vocabulary.primitives.items()
        if each.shape is not None and each.shape.spatial[:1] == (CAMERA,)
    ]


def _mount(pose: Rigid) -> Mount:
    ahead = pose.turned(1.0, 0.0, 0.0)
    return Mount(pose.x, pose.y, math.degrees(portable.atan2(ahead[1], ahead[0])))
