"""`minerva top`: a running world in the terminal."""
