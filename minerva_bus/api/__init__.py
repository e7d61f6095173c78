"""The Python interface: worlds, runs, collected data and records, without a command line."""
