"""Base of all bridges: connecting, reconnecting and counting."""

from minerva_services.bridging.bridge import Bridge, Source, SourceError

__all__ = ["Bridge", "Source", "SourceError"]
