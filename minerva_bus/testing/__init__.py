"""What helps to test worlds, agents and services; open to users."""
