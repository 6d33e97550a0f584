"""Foreign skeleton logs: one module a format, found by content and not by a file's name.

A format module has two functions::

    def matches(head: bytes) -> bool      # the file's first 64 KiB: is it this format?
    def read(path: Path, options: ReadOptions) -> list[SkeletonClip]     # one clip a performer

`read` raises `SkeletonLogError` where the file does not fit, with the line number where the format has lines.
"""
