"""The 3D view: its options."""

from __future__ import annotations

from minerva_bus.errors import MisuseError
from minerva_services.views.window import Painter, WindowDevice, WindowOptions


class OpenGL(WindowDevice, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, in three dimensions.

    Walls stand on floors, discs are drums of the height given by their form, texts stand on pins.
    Without `path` and `video` it opens an interactive window.

    Args:
        width: width of the window or picture in pixels.
        height: height in pixels.
        path: a PNG file instead of a window; each picture replaces the previous one atomically.
        every: frames between views; 0: 10 for pictures, 1 for a video, and by the clock for a
          window.
        frames: keep all pictures, numbered by frame, as in `world-000010.png`.
        video: an MP4 or GIF file instead of a window; needs `pip install 'minerva-bus[video]'`.
        fps: frame rate of the video; 0: as many pictures as there are views.
        speed: speed of the video relative to simulated time.
        azimuth: camera direction in degrees: -90 from the south, as on a map.
        elevation: degrees above the floor, 8 to 90; 90 looks straight down.
        zoom: magnification relative to showing the whole world.
        follow: an agent to keep in the middle.
        click: the event type sent by a click on a label, with its text.
        slide: the event type sent by the arrow keys, with a number.
        draws: visual event types, comma-separated, drawn over each other.

    """

    def __init__(
        self,
        width: int = 1200,
        height: int = 800,
        path: str = "",
        every: int = 0,
        frames: bool = False,
        video: str = "",
        fps: float = 0.0,
        speed: float = 1.0,
        azimuth: float = -90.0,
        elevation: float = 60.0,
        zoom: float = 1.0,
        follow: str = "",
        click: str = "",
        slide: str = "",
        draws: str = "ePicture",
    ) -> None:
        if not 8 <= elevation <= 90:
            raise MisuseError(f"opengl: elevation is {elevation:g}; expected 8 to 90 degrees")
        if not -360 <= azimuth <= 360:
            raise MisuseError(f"opengl: azimuth is {azimuth:g}; expected -360 to 360 degrees")
        if not 0.01 <= zoom <= 1000:
            raise MisuseError(f"opengl: zoom is {zoom:g}; expected 0.01 to 1000")
        options = WindowOptions(
            "opengl",
            needs=("moderngl", "pygame"),
            width=width,
            height=height,
            path=path,
            every=every,
            frames=frames,
            video=video,
            fps=fps,
            speed=speed,
            click=click,
            slide=slide,
            follow=follow,
        )
        super().__init__(options, draws)
        self._camera = azimuth, elevation, zoom

    def painter(self) -> Painter:
        from minerva_services.views.opengl.painter import GLPainter

        return GLPainter(*self._camera)
