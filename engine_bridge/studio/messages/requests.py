"""Every request that the server accepts."""

from typing import get_args

from engine_bridge.studio.messages import characters, connection, film, performers, takes
from engine_bridge.studio.messages.base import Request

REQUESTS: dict[str, type[Request]] = {
    get_args(each.model_fields["do"].annotation)[0]: each
    for module in (characters, connection, film, performers, takes)
    for each in vars(module).values()
    if isinstance(each, type) and issubclass(each, Request) and each is not Request
}
"""Classes of requests by their `do`."""
