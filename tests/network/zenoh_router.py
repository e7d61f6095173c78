"""What `zenohd -c FILE` is: a Zenoh router by a configuration, until it is killed."""

import sys
import threading

import zenoh

with zenoh.open(zenoh.Config.from_file(sys.argv[1])):
    print("the router is open", flush=True)
    threading.Event().wait()
