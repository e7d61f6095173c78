"""The 2D view."""

from __future__ import annotations

from minerva_services.views.window import Painter, WindowDevice


class Sprites(WindowDevice, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, as sprites seen from above.

    Args:
        draws: visual event types, comma-separated; their views are drawn over each other. Further
          options are those of `WindowOptions`.

    """

    service = "sprites"

    def painter(self) -> Painter:
        from minerva_services.views.sprites.painter import SpritePainter

        return SpritePainter()
