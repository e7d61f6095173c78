"""Worlds for programs with a language model.

`minds` are agents that represent slow participants, `llm` is the service that asks a language model
in their place, and `mcp` serves a running world by the Model Context Protocol (`minerva mcp`).
"""
