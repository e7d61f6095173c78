"""Models for mesa-frames, with expressions of polars."""
