"""The command `minerva`: thin, and the only package of the kernel that imports typer."""
