"""Sources of these tests do not wait."""

from ..devices import unhurried

__all__ = ["unhurried"]
