"""A page in the browser that shows the world in three dimensions and takes people's orders."""

from minerva_services.views.web.service import Web

__all__ = ["Web"]
