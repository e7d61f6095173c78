"""Records of runs: MCAP files with the string of every frame, readable by other tools, too.

format of entries, in records and journals    log/entries.py
channels of a record                          log/channels.py
writing and reading a record                  log/record_writer.py, log/record.py
format of a journal                           log/journal.py
"""
