"""From a world file to running processes."""
