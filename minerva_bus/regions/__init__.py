"""Regions: parts of one world's string that evolve independently, each with its own algorithm."""
