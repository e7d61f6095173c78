"""A 3D view of a world in an OpenGL window: the paper's figure 3."""

from minerva_services.views.opengl.service import OpenGL

__all__ = ["OpenGL"]
