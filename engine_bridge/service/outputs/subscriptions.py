"""The subscriptions on one socket and the answers that are due there, bounded whatever clients send."""

from collections import Counter
from collections.abc import Iterable

from engine_bridge.service.protocol.header import NAME, TOPIC_BYTES, WORDS

MAX_SUBSCRIPTIONS = 4096
"""Number of different subscriptions from which on new ones to characters that do not exist yet are ignored."""

MAX_PENDING = 1024
"""Maximum number of topics that wait for an answer."""

ANSWER_SECONDS = 1.0
"""Minimum time between two answers on one topic, in seconds."""

ANSWER_BYTES_PER_SECOND = 500e6
"""Maximum rate of answers, so that frames are sent while many clients request scenes."""


class Subscriptions:
    """The subscriptions of all clients of one socket.

    A subscription matches every topic field that begins with it, and counts once for each time that it was made. A
    client that withdraws a subscription it never made removes none of another client. A client that subscribes twice
    and disconnects may count for longer than it was connected; this costs work, but no client loses a message.

    Attributes
    ----------
    ignored : int
        Number of subscriptions so far that no topic can match, or that exceeded `MAX_SUBSCRIPTIONS`.
    """

    def __init__(self) -> None:
        self.ignored = 0
        self._made: dict[bytes, Counter[int]] = {}
        self._held: Counter[bytes] = Counter()

    def add(self, prefix: bytes, connection: int, fields: Iterable[bytes]) -> None:
        """Add a subscription.

        Parameters
        ----------
        prefix : bytes
        connection : int
            The connection that it came from.
        fields : iterable of bytes
            The existing topic fields; a subscription that matches one of them is always kept.
        """
        may_come = _may_come(prefix) and len(self._held) < MAX_SUBSCRIPTIONS
        if prefix not in self._held and not may_come and not any(field.startswith(prefix) for field in fields):
            self.ignored += 1
            return
        self._held[prefix] += 1
        self._made.setdefault(prefix, Counter())[connection] += 1

    def remove(self, prefix: bytes, connection: int | None) -> None:
        """Remove a subscription that a client withdraws; `connection` is None if the client has disconnected."""
        if prefix not in self._held:
            return
        if connection is not None:
            if not self._made[prefix][connection]:
                return
            self._made[prefix][connection] -= 1
        self._held[prefix] -= 1
        if not self._held[prefix]:
            del self._held[prefix], self._made[prefix]

    def forget(self, connection: int) -> None:
        """Forget the subscriptions that a connection, which has ended, could withdraw."""
        for made in self._made.values():
            made.pop(connection, None)

    def wants(self, field: bytes) -> bool:
        """Tell whether a client subscribes to a topic field."""
        return any(field[:end] in self._held for end in range(TOPIC_BYTES + 1))


def _may_come(prefix: bytes) -> bool:
    """Tell whether a subscription could match topics of a character."""
    name, slash, rest = prefix.decode("latin-1").partition("/")
    word, zero, more = rest.partition("\0")
    if not NAME.fullmatch(name) or len(prefix) > TOPIC_BYTES:
        return False
    if zero:
        return word in WORDS and not more.strip("\0")
    return not slash or any(each.startswith(word) for each in WORDS)


class Answers:
    """Topics to send again because a client has just requested them.

    Each is answered at most once in `ANSWER_SECONDS`, and all together at `ANSWER_BYTES_PER_SECOND` or less.
    """

    def __init__(self) -> None:
        self._pending: dict[bytes, float] = {}
        self._given: dict[bytes, float] = {}
        self._free = float("-inf")

    def ask(self, field: bytes, now: float) -> bool:
        """Add a topic unless it is pending already; return False if too many are pending."""
        if field not in self._pending and len(self._pending) >= MAX_PENDING:
            return False
        self._pending.setdefault(field, max(now, self._given.get(field, now - ANSWER_SECONDS) + ANSWER_SECONDS))
        return True

    def due(self) -> float:
        """Return when the next answer may be sent."""
        return max(self._free, min(self._pending.values())) if self._pending else float("inf")

    def take(self, now: float) -> bytes | None:
        """Remove and return a topic that may be answered now."""
        if now < self._free:
            return None
        field = next((field for field, earliest in self._pending.items() if earliest <= now), None)
        if field is not None:
            del self._pending[field]
        return field

    def given(self, field: bytes, size: int, now: float) -> None:
        """Record that a topic was answered with so many bytes."""
        self._free = now + size / ANSWER_BYTES_PER_SECOND
        self._given = {each: time for each, time in self._given.items() if now - time < ANSWER_SECONDS}
        self._given[field] = now
