"""Reads world files and runs their processes.

The policy for failures of a process is in launch/process_specs.py, what happens when it ends in
launch/supervisor.py; what a frame does without its member, in frame/member_lifecycle.py.
"""
