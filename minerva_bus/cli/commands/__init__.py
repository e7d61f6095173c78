"""The commands with their options; what a command does is imported when it is called.

A new command is a function with two examples in one of these modules, and its name in `COMMANDS` of
cli/main.py.
"""
