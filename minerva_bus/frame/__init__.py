"""Table 2 as a pure state machine, and who takes part in it: no clock, socket or thread."""
