"""A page in the browser that shows the world in 3D and accepts users' orders."""

from minerva_services.views.web.service import Web

__all__ = ["Web"]
