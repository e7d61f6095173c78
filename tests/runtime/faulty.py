"""A clock and a backend that fail on request: the file `fault.txt` names the fault."""

import threading
import time
from importlib.util import find_spec
from pathlib import Path

from town import eHappy, eStep

from minerva_bus import Generator

FAULT = Path(__file__).with_name("fault.txt")
LOCK = threading.Lock()


def fault(name):
    return FAULT.read_text() == name


def waits_for_lock():
    LOCK.acquire()
    while fault("lock"):
        LOCK.acquire(timeout=0.1)
    LOCK.release()


def sleeps():
    while fault("sleep"):
        time.sleep(0.1)


def compiles():
    if fault("compile"):  # as a stack in the compiler looks like, which may be too deep to be read
        (folder,) = find_spec("numba").submodule_search_locations
        wait = compile("while fault('compile'): time.sleep(0.1)", f"{folder}/compiler.py", "exec")
        exec(wait, globals())


class Clock(Generator, events=("eStep",)):
    def generate(self, tick):
        sleeps()
        waits_for_lock()
        compiles()
        if fault("slow"):
            time.sleep(0.3)
        return () if fault("quiet") else (eStep(),)


class Extra(Generator, events=("eHappy",)):
    def generate(self, tick):
        return (eHappy(),)


def decide(request):
    while fault("llm"):
        time.sleep(0.1)
    return '{"action": "eat", "amount": 1}'
