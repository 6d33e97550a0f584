"""Who wants what on one socket, and what is still to be answered there: bounded, whatever clients send."""

from collections import Counter
from collections.abc import Iterable

from engine_bridge.service.protocol.header import NAME, TOPIC, WORDS

MOST_REMEMBERED = 4096
"""Different subscriptions to characters that are not there, kept for when they come."""

MOST_PENDING = 1024
"""Topics that wait for an answer."""

ANSWER_EVERY = 1.0
"""Seconds between two answers on one topic."""

ANSWER_RATE = 500e6
"""Bytes of answers a second, so that frames have their turn while a crowd asks for scenes."""


class Subscriptions:
    """What the clients of one socket have subscribed to.

    A subscription stands for every topic field that begins with it. It counts once for each time that it was made. A
    client that withdraws what it has never asked for takes nothing from others; one that asks twice and leaves may
    count for longer than it was there, which costs work and no client a message.

    Attributes
    ----------
    ignored : int
        Subscriptions so far that no topic can match, or for which there was no room.
    """

    def __init__(self) -> None:
        self.ignored = 0
        self._made: dict[bytes, Counter[int]] = {}
        self._held: Counter[bytes] = Counter()

    def add(self, prefix: bytes, connection: int, fields: Iterable[bytes]) -> None:
        """Take a subscription.

        Parameters
        ----------
        prefix : bytes
        connection : int
            Where it came from.
        fields : iterable of bytes
            The topic fields that there are; what matches one of them is always taken.
        """
        may_come = _may_come(prefix) and len(self._held) < MOST_REMEMBERED
        if prefix not in self._held and not may_come and not any(field.startswith(prefix) for field in fields):
            self.ignored += 1
            return
        self._held[prefix] += 1
        self._made.setdefault(prefix, Counter())[connection] += 1

    def remove(self, prefix: bytes, connection: int | None) -> None:
        """Drop a subscription, because a client says so or, without a connection, because it has gone."""
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
        """Let nobody drop anything in the name of a connection that has ended."""
        for made in self._made.values():
            made.pop(connection, None)

    def wants(self, field: bytes) -> bool:
        """Tell whether somebody wants what is sent under a topic field."""
        return any(field[:end] in self._held for end in range(TOPIC + 1))


def _may_come(prefix: bytes) -> bool:
    """Tell whether a subscription could match topics of a character."""
    name, slash, rest = prefix.decode("latin-1").partition("/")
    word, zero, more = rest.partition("\0")
    if not NAME.fullmatch(name) or len(prefix) > TOPIC:
        return False
    if zero:
        return word in WORDS and not more.strip("\0")
    return not slash or any(each.startswith(word) for each in WORDS)


class Answers:
    """Topics on which something is to be sent again because somebody has just asked for it.

    Each is answered at most once in `ANSWER_EVERY` seconds, and all together with no more than `ANSWER_RATE`.
    """

    def __init__(self) -> None:
        self._pending: dict[bytes, float] = {}
        self._given: dict[bytes, float] = {}
        self._free = float("-inf")

    def ask(self, field: bytes, now: float) -> bool:
        """Put a topic on the list if it is not there yet; False if the list is full."""
        if field not in self._pending and len(self._pending) >= MOST_PENDING:
            return False
        self._pending.setdefault(field, max(now, self._given.get(field, now - ANSWER_EVERY) + ANSWER_EVERY))
        return True

    def due(self) -> float:
        """Return when the next answer may be given."""
        return max(self._free, min(self._pending.values())) if self._pending else float("inf")

    def take(self, now: float) -> bytes | None:
        """Take a topic off the list that may be answered now."""
        if now < self._free:
            return None
        field = next((field for field, earliest in self._pending.items() if earliest <= now), None)
        if field is not None:
            del self._pending[field]
        return field

    def given(self, field: bytes, size: int, now: float) -> None:
        """Take note that a topic was answered with so many bytes."""
        self._free = now + size / ANSWER_RATE
        self._given = {each: time for each, time in self._given.items() if now - time < ANSWER_EVERY}
        self._given[field] = now
