"""Collection of data of a run: rows of each frame, agent or event, as columns."""
