"""Zenoh: sessions, members and the coordinator. The only package of the kernel that imports zenoh.

the coordinator's loop                           runtime/coordinator.py
messages as they arrive, and what is refused     runtime/receiver.py
limits, and roles by certificates                runtime/admission.py
time-outs of members that do not answer          runtime/timeouts.py
the process of a member, and how it joins        runtime/participants.py, runtime/joining.py

A member that breaks the protocol is excluded in frame/member_lifecycle.py.
"""
