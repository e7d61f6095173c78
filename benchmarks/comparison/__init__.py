"""The public comparison of agent-based frameworks, with measured and published systems."""
