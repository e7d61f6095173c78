"""Collection of data of a run: rows of each frame, agent or event, as columns.

The events of a frame are collected elsewhere: steps 2 to 4 of Table 2 in
frame/collection_step.py, and equation 6 in world/event_collection.py.
"""
