"""Cameras that see markers: videos, devices and streams, or images that others publish."""

from minerva_services.vision.markers import Markers
from minerva_services.vision.service import Vision

__all__ = ["Markers", "Vision"]
