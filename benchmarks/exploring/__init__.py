"""Floors, a fast simulation and strategies for `python -m benchmarks.exploration`."""
