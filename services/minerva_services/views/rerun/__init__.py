"""Recordings of views for the Rerun viewer."""

from minerva_services.views.rerun.service import RerunView

__all__ = ["RerunView"]
