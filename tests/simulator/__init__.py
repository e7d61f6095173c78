"""Whole worlds in one thread, with time, randomness and faults determined by one seed.

Coordinator, members and launcher are the real ones; clock, network and processes are
simulated. docs/testing.md describes what the simulation covers.
"""
