"""Random streams: one for each (seed, who, frame), whatever runs where."""

from hashlib import blake2b

import numpy as np


def stream(seed: int, who: str, frame: int) -> np.random.Generator:
    """The stream of an agent (`#id`) or a generator (its name) in a frame.

    A Philox counter generator keyed by BLAKE2b of the three: no draw depends on another's.
    """
    key = blake2b(f"{seed}\0{who}\0{frame}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(key, "little")))
