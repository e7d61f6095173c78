"""Sonification: a view rendered to a WAV file instead of a picture."""

from minerva_services.views.sound.service import Sound

__all__ = ["Sound"]
