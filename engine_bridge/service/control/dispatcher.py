"""Answers requests of clients, whichever wire they arrive on (docs/control.md)."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from engine_bridge.service.control import requests
from puppetline import toml_schema
from puppetline.errors import PuppetlineError, ServiceError
from puppetline.toml_schema import Table

MAX_DEFERRED = 256
"""Maximum number of answers that are sent in a later turn of the loop."""

Command = tuple[type[Table], Callable[[Any], Any]]
"""Model of the arguments, and the function that is called with them; it returns JSON's types or a `Deferred`."""

Reply = Callable[[bytes], None]
"""Sends a reply to the client that made the request."""

FAILED = ServiceError(
    "the service",
    found="an internal error",
    expected="a result",
    fix="Read the log of the service, and report the error.",
)
BUSY = ServiceError(
    "the service", found="too many pending requests", expected="fewer requests at a time", fix="Retry in a few seconds."
)

log = logging.getLogger(__name__)


class Deferred:
    """An answer that is sent in a later turn of the loop, by `Dispatcher.finish`."""


@dataclass
class _Caller:
    """Destination of an answer: what sends it, its encoding, and the number of its request."""

    reply: Reply
    encoding: requests.Encoding
    request: requests.RequestId = None


class Dispatcher:
    """Carries out requests, and answers each with one reply, whatever it contains.

    Parameters
    ----------
    commands : mapping
        Commands by name. The client receives a `PuppetlineError`; any other exception is logged.
    """

    def __init__(self, commands: Mapping[str, Command]) -> None:
        self._commands = commands
        self._deferred: dict[Deferred, _Caller] = {}

    def take(self, body: bytes, reply: Reply, encoding: requests.Encoding) -> None:
        """Carry out a request; the reply, in the same encoding, is sent now or when the work is done."""
        caller = _Caller(reply, encoding)
        try:
            outcome = self._carry_out(caller, body)
        except Exception as error:  # a command must not end the service
            outcome = error
        if not isinstance(outcome, Deferred):
            caller.reply(_encoded(caller, outcome))
        elif len(self._deferred) < MAX_DEFERRED:
            self._deferred[outcome] = caller
        else:
            caller.reply(_encoded(caller, BUSY))

    def finish(self, deferred: Deferred, outcome: Any) -> None:
        """Send a deferred answer: a result, or the exception that was raised instead."""
        caller = self._deferred.pop(deferred, None)
        if caller is not None:
            caller.reply(_encoded(caller, outcome))

    def _carry_out(self, caller: _Caller, body: bytes) -> Any:
        values = requests.decode(body, caller.encoding)
        caller.request = requests.take_id(values)
        model, run = self._commands[requests.take_command(values, self._commands)]
        return run(toml_schema.check(model, values, requests.WHERE, ServiceError))


def refusal(error: PuppetlineError, encoding: requests.Encoding) -> bytes:
    """Return the reply to a message that is not a request."""
    return requests.encode(requests.error_reply(None, error), encoding)


def _encoded(caller: _Caller, outcome: Any) -> bytes:
    """Write the answer; an internal error is logged, and the client receives `FAILED`."""
    try:
        if not isinstance(outcome, Exception):
            return requests.encode(requests.ok_reply(caller.request, outcome), caller.encoding)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        outcome = error
    if not isinstance(outcome, PuppetlineError):
        log.error("request failed", exc_info=outcome)
        outcome = FAILED
    return requests.encode(requests.error_reply(caller.request, outcome), caller.encoding)
