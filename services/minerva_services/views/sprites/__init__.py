"""A view in 2D: sprites in a window, in PNG files or in a video (figure 2)."""

from minerva_services.views.sprites.service import Sprites

__all__ = ["Sprites"]
