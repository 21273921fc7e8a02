"""Bytes changed at random, as bad disks, bad copies and bad programs change them."""

from __future__ import annotations

import numpy as np


def mutated(raw: bytes, random: np.random.Generator) -> tuple[bytes, str]:
    """Change some bytes; returns the bytes and what was done."""
    data, done = bytearray(raw), []
    for _ in range(int(random.integers(1, 4))):
        at = int(random.integers(0, len(data) + 1))
        length = int(random.integers(1, 40))
        match int(random.integers(6)):
            case 0 if at < len(data):
                data[at] ^= 1 << int(random.integers(8))
                done.append(f"bit flipped at {at}")
            case 1:
                del data[at : at + length]
                done.append(f"{length} bytes cut at {at}")
            case 2:
                data[at:at] = random.bytes(length)
                done.append(f"{length} bytes of noise put in at {at}")
            case 3:
                data[at:at] = data[max(0, at - length) : at]
                done.append(f"{length} bytes twice at {at}")
            case 4:
                data[at : at + length] = bytes(len(data[at : at + length]))
                done.append(f"{length} zeros at {at}")
            case _:
                del data[at:]
                done.append(f"cut off at {at}")
    return bytes(data), ", ".join(done)
