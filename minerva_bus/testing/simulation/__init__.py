"""Whole worlds in one thread, in which all time, chance and faults come from one seed.

The coordinator, the members and the launcher are the real ones; clock, network and processes are
simulated. docs/testing.md says what that covers and what it does not.
"""
