"""Agents that come with Minerva Bus, apart from the bus itself."""
