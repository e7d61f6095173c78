"""Records of runs: MCAP files with the string of every frame, readable by other tools, too."""
