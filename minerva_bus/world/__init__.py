"""Events, agents, evolution and views: equations 2 to 6."""
