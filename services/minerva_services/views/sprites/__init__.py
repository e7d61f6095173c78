"""A 2D view: sprites in a window, in PNG files or in a video (figure 2)."""

from minerva_services.views.sprites.service import Sprites

__all__ = ["Sprites"]
