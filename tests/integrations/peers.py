"""What peers say that break ZMTP 3 or that are no service at all, before and after its handshake."""

import random

GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(52, b"\0")
READY = b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03PUB"
MANY = 256 << 20
"""The largest message that is taken, in bytes."""

NOISE = random.Random(7).randbytes(100_000)


def command(body, flags=4):
    return bytes([flags, len(body)]) + body


def large(size, flags=2):
    return bytes([flags]) + size.to_bytes(8, "big")


BEFORE_THE_HANDSHAKE = {
    "nothing": b"",
    "HTTP": b"HTTP/1.1 400 Bad Request\r\n\r\n<html>" + b"x" * 10_000,
    "noise": NOISE,
    "version 2": b"\xff" + bytes(8) + b"\x7f\x01",
    "a whole greeting of version 2": GREETING[:10] + b"\x01" + GREETING[11:],
    "a greeting and noise": GREETING + b"\xf0" + NOISE,
    "a message too early": GREETING + b"\0\1a",
    "another command": GREETING + command(b"\5HELLO"),
    "a huge command": GREETING + large(1 << 20, flags=6),
}
AFTER_THE_HANDSHAKE = {
    "a size of 2^62": large(2**62),
    "a size of 2^64 - 1": large(2**64 - 1),
    "more than is taken": large(MANY + 1),
    "a command of a megabyte": large(1 << 20, flags=6),
    "several parts": b"\1\1a\0\1b",
    "a long message of several parts": large(2**62, flags=3),
    "a command of several parts": b"\5\1a",
    "flags that there are not": b"\x80\1a",
    "a command without a name": command(b""),
    "a name of no length": command(b"\0"),
    "a name longer than the command": command(b"\xffPING"),
}
