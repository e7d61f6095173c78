"""Geometric systems that several services share: pictures, bounding volumes and colors.

A system whose items depend on single parts of a view derives from `incremental.ItemGeometry`.
"""
