"""Table 2 as a pure state machine with its members: no clock, socket or thread.

all steps in their order     frame/algorithm.py
members come, go and die     frame/member_lifecycle.py
steps 2 to 4, events         frame/collection_step.py
who may send which events    frame/sender_rights.py
steps 5, 6, 8, evolution     frame/evolution_step.py
step 7, views                frame/view_streams.py
agents to hosts              frame/placement.py
the side of a member         frame/member_side.py
all messages                 frame/messages.py
"""
