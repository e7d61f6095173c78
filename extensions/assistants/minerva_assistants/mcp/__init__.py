"""A Model Context Protocol server for worlds: their state as resources, operations as tools.

Its client is a program with a language model, whose arguments are not trusted. A tool is checked
against its JSON Schema and the server's permissions before it runs; then it uses the same functions
as the command line.
"""
