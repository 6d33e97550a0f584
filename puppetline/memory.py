"""Memory of this process."""

import ctypes
import sys


def trim_memory() -> None:
    """Return freed memory to the system: glibc would keep hundreds of megabytes."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
        if trim is not None:
            trim(0)
