"""What all bridges to sensors share: connecting, reconnecting, and counting what happens."""

from minerva_services.bridging.bridge import Bridge, Source, SourceError

__all__ = ["Bridge", "Source", "SourceError"]
