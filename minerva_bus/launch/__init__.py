"""Reads world files and runs their processes.

What happens when a process ends is in launch/supervisor.py; what a frame does without its member,
in frame/member_lifecycle.py.
"""
