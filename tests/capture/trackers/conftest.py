"""Sources of these tests do not wait."""

from ..sensors.conftest import unhurried

__all__ = ["unhurried"]
