"""The 2D view: its options, and which geometric system draws it."""

from __future__ import annotations

from minerva_services.views.window import Painter, Showing, WindowDevice


class Sprites(WindowDevice, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, as sprites seen from above.

    Args:
        width: pixels, of the window or of what is written.
        height: pixels.
        path: a PNG file instead of a window; each picture replaces the one before, in one step.
        every: frames from one view to the next. 0: thirty views a second in a window, a picture
            each 10 frames, each frame in a video.
        frames: keep all pictures, numbered by frame, as in `minerva-000010.png`.
        video: an .mp4 or .gif file instead of a window.
        fps: pictures a second of the video; 0: as many as there are views, up to 60 (GIF: 25).
        speed: of the video, in times the world's own; where it is 1, worlds whose frames last
            longer than a tenth of a second are shown at ten frames a second.
        follow: an agent that stays in the middle.
        click: the event type that a click on a label sends, where the world takes several.
        slide: the event type that the arrow keys send, where the world takes several.
        draws: visual event types, separated by commas; their views lie over one another.

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
            Showing(
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
