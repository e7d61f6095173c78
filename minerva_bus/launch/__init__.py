"""Reads world files and runs their processes."""
