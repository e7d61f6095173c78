"""The 2D view: its options."""

from __future__ import annotations

from minerva_services.views.window import Painter, WindowDevice, WindowOptions


class Sprites(WindowDevice, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, as sprites seen from above.

    Args:
        width: width of the window or picture in pixels.
        height: height in pixels.
        path: a PNG file instead of a window; each picture replaces the previous one atomically.
        every: frames between views. 0: thirty views per second in a window, every 10th frame as a
          picture, every frame in a video.
        frames: keep all pictures, numbered by frame, as in `minerva-000010.png`.
        video: an .mp4 or .gif file instead of a window.
        fps: frame rate of the video; 0: as many pictures as there are views, up to 60 (GIF: 25).
        speed: speed of the video relative to simulated time; at 1, worlds with frames longer than a
          tenth of a second are shown at ten frames per second.
        follow: an agent to keep in the middle.
        click: the event type sent by a click on a label, if the world accepts several.
        slide: the event type sent by the arrow keys, if the world accepts several.
        draws: visual event types, comma-separated; their views are drawn over each other.

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
        follow: str = "",
        click: str = "",
        slide: str = "",
        draws: str = "ePicture",
    ) -> None:
        super().__init__(
            WindowOptions(
                "sprites",
                ("pygame",),
                width=width,
                height=height,
                path=path,
                every=every,
                frames=frames,
                video=video,
                fps=fps,
                speed=speed,
                follow=follow,
                click=click,
                slide=slide,
            ),
            draws,
        )

    def painter(self) -> Painter:
        from minerva_services.views.sprites.painter import SpritePainter

        return SpritePainter()
