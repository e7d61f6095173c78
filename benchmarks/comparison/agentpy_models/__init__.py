"""Models for AgentPy."""
