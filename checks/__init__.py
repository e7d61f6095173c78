"""Long checks of the platform under faults, garbage and mutations, run by hand and by CI."""
