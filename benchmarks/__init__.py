"""Benchmarks and long checks that are run manually and are not part of the tests."""
