"""Input: people and clocks as event generators (Table 4)."""
