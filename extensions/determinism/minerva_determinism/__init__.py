"""Whether the same seed gives the same strings: in two layouts of processes, or in all of them.

layouts       runs of a world in layouts: processes, environments, kills, continued records
killer        kills processes of a running world in turn
positions     a member that dies at each message of a frame, in one process
suspects      lines of a world's code that can make its runs differ
determinism   `minerva determinism`: two layouts, compared
certificate   `minerva certify`: all layouts, as a table in text, JSON and HTML
"""
