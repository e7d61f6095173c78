"""Records of runs: MCAP files with the string of every frame, which other tools can show, too."""
