"""What the commands of the live service are tested with: its own tests' fixtures."""

from ..service.conftest import free_port, kung_fu, listen, sender, serve

__all__ = ["free_port", "kung_fu", "listen", "sender", "serve"]
