"""Live views for Foxglove and Lichtblick, over a WebSocket."""

from minerva_services.views.foxglove.service import Foxglove

__all__ = ["Foxglove"]
