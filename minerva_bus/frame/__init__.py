"""Table 2 as a pure state machine with its members: no clock, socket or thread."""
