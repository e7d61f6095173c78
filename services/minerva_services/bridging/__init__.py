"""Base of all bridges: connecting, reconnecting and counting."""

from minerva_services.bridging.bridge import Bridge, OpenSource, Source, SourceError

__all__ = ["Bridge", "OpenSource", "Source", "SourceError"]
