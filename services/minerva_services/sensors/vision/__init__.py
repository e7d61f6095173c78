"""Cameras that see markers: videos, devices and streams, or images that others publish."""

from minerva_services.sensors.vision.markers import Markers
from minerva_services.sensors.vision.service import Vision

__all__ = ["Markers", "Vision"]
