"""Acceptance: Minerva Bus judged by test suites that others wrote and published."""
