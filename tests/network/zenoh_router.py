"""Stand-in for `zenohd -c FILE`: a Zenoh router that runs until it is killed."""

import sys
import threading

import zenoh

with zenoh.open(zenoh.Config.from_file(sys.argv[1])):
    print("the router is open", flush=True)
    threading.Event().wait()
