"""Cameras that recognise markers: videos, devices, streams, or images of other members."""

from minerva_services.sensors.vision.markers import Markers
from minerva_services.sensors.vision.service import Vision

__all__ = ["Markers", "Vision"]
