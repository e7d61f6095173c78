"""The command `minerva`: thin, and the only package that imports typer."""
