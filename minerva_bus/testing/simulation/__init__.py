"""Whole worlds in one thread, with time, randomness and faults determined by one seed.

Coordinator, members and launcher are the real ones; clock, network and processes are
simulated. docs/testing.md says what that covers and what it does not.
"""
