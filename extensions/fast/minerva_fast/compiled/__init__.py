"""Methods for one agent as machine code: checks of their form, generated modules, their cache."""
