"""The view in three dimensions."""

from __future__ import annotations

from minerva_bus.errors import MisuseError
from minerva_services.views.window import Painter, Showing, WindowDevice


class OpenGL(WindowDevice, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, in three dimensions.

    Walls stand on floors, discs are drums as high as their form says, texts stand on pins. Without
    `path` and `video` it is a window, with a person's hands on the world.

    Args:
        width: pixels, of the window or the picture.
        height: pixels.
        path: a PNG file instead of a window; each picture replaces the one before, in one step.
        every: frames between views; 0: what suits, 10 for pictures and 1 for a video, and in a
            window as many as it shows.
        frames: keep all pictures, numbered by frame, as in `world-000010.png`.
        video: an MP4 or GIF file instead of a window; needs `pip install 'minerva-bus[video]'`.
        fps: of the video, pictures a second; 0: as many as there are views.
        speed: of the video, world's seconds in one of the video's.
        azimuth: degrees, from where the camera looks: -90 from the south, as on a map.
        elevation: degrees above the floor, 8 to 90; at 90 it looks straight down.
        zoom: how many times nearer than needed to see the whole world.
        follow: an agent that stays in the middle.
        click: the event type that a click on a label sends, with its text.
        slide: the event type that the arrow keys send, with a number.
        draws: visual event types, separated by commas, drawn one over the other.

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
        showing = Showing(
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
        super().__init__(showing, draws)
        self._camera = azimuth, elevation, zoom

    def painter(self) -> Painter:
        from minerva_services.views.opengl.painter import GLPainter

        return GLPainter(*self._camera)
