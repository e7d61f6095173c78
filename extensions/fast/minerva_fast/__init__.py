"""Machine code for methods and views of agents, and spaces with compiled rules."""
