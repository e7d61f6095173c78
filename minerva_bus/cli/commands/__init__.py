"""The commands with their options; what a command does is imported when it is called."""
