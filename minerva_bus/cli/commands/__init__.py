"""What typer is told of each command; what a command does is imported once it is called."""
