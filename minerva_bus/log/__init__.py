"""Records of runs: MCAP files that other tools show, and from which every string can be had."""
