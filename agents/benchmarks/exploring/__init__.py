"""Floors, a fast simulation and strategies for `python -m agents.benchmarks.exploration`."""
