"""The 3D view: its options."""

from __future__ import annotations

from typing import Any

from minerva_bus.errors import MisuseError
from minerva_services.options import takes_options
from minerva_services.views.window import Painter, WindowDevice, WindowOptions


class OpenGL(WindowDevice, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, in three dimensions.

    Walls stand on floors, discs are drums of the height given by their form, texts stand on pins.
    Without `path` and `video` it opens an interactive window.

    Args:
        azimuth: camera direction in degrees: -90 from the south, as on a map.
        elevation: degrees above the floor, 8 to 90; 90 looks straight down.
        zoom: magnification relative to showing the whole world.
        draws: visual event types, comma-separated; their views are drawn over each other. Further
          options are those of `WindowOptions`.

    """

    service = "opengl"
    needs = "moderngl", "pygame"
    space = True

    @takes_options(WindowOptions, without=("service", "needs", "environment"))
    def __init__(
        self,
        azimuth: float = -90.0,
        elevation: float = 60.0,
        zoom: float = 1.0,
        draws: str = "ePicture",
        **window: Any,
    ) -> None:
        if not 8 <= elevation <= 90:
            raise MisuseError(f"opengl: elevation is {elevation:g}; expected 8 to 90 degrees")
        if not -360 <= azimuth <= 360:
            raise MisuseError(f"opengl: azimuth is {azimuth:g}; expected -360 to 360 degrees")
        if not 0.01 <= zoom <= 1000:
            raise MisuseError(f"opengl: zoom is {zoom:g}; expected 0.01 to 1000")
        super().__init__(draws, **window)
        self._camera = azimuth, elevation, zoom

    def painter(self) -> Painter:
        from minerva_services.views.opengl.painter import GLPainter

        return GLPainter(*self._camera)
