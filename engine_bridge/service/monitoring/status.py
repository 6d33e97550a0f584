"""The status of the service: one value that the table, Prometheus, systemd and the stream read.

`Status.as_json` is what is published on ``service/status`` (docs/protocol.md).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class ServiceStatus:
    """The process.

    Attributes
    ----------
    version : str
    uptime : float
        Seconds since the start.
    pid : int
    memory : int
        Resident bytes.
    cpu : float
        Share of one core since the previous status.
    """

    version: str
    uptime: float
    pid: int
    memory: int
    cpu: float


@dataclass(frozen=True)
class LatencyStatus:
    """Percentiles of the time from a skeleton to its frame, in milliseconds; None without frames."""

    p50: float | None = None
    p95: float | None = None
    p99: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class UserStatus:
    """A performer in view.

    Attributes
    ----------
    user : int
        The source's number for the performer.
    state : str
        One of `engine_bridge.service.states.STATES`.
    character : str or None
        The character that the performer drives.
    seen : float
        Seconds since the performer was last tracked.
    distance : float
        From the sensor, in metres.
    height, reach : float or None
        Of the performer's body, in metres; None before the calibration.
    """

    user: int
    state: str
    character: str | None
    seen: float
    distance: float
    height: float | None
    reach: float | None


@dataclass(frozen=True)
class SensorStatus:
    """Position of the sensor: tilt and roll in degrees, height above the floor in metres."""

    tilt: float
    height: float
    roll: float


@dataclass(frozen=True)
class StageStatus:
    """A stage.

    Attributes
    ----------
    name : str
    source : str
        URI.
    frames : int
        Skeletons received so far.
    rate : float
        Skeletons per second, over the last seconds.
    dropped : int
        Skeletons skipped so far because a newer one of the same performer had arrived.
    refused : dict
        Packets that were not understood, by reason.
    faults : int
        Events lost to internal errors.
    latency_ms : LatencyStatus
    users : sequence of UserStatus
    sensor : SensorStatus
    recording : str or None
        Name of the take that is being recorded.
    count_in : int
        Seconds until a take begins, rounded up; 0 without a count-in.
    """

    name: str
    source: str
    frames: int
    rate: float
    dropped: int
    refused: dict[str, int]
    faults: int
    latency_ms: LatencyStatus
    users: Sequence[UserStatus]
    sensor: SensorStatus
    recording: str | None
    count_in: int = 0


@dataclass(frozen=True)
class CharacterStatus:
    """A character.

    Attributes
    ----------
    name : str
    stage : str
        Name of its stage.
    performer : int or None
        User number.
    state : str
        One of `engine_bridge.service.states.STATES`.
    frames : int
        Frames sent so far.
    rate : float
        Frames per second, over the last seconds.
    residual : float or None
        Distance of the last pose from the morph basis; None without one.
    limited : int
        Frames whose pose exceeds the range of the morph weights.
    """

    name: str
    stage: str
    performer: int | None
    state: str
    frames: int
    rate: float
    residual: float | None
    limited: int


@dataclass(frozen=True)
class ClientsStatus:
    """ZeroMQ clients: connected to the stream, connections refused so far, and the maximum number of clients."""

    connected: int
    refused: int
    limit: int


@dataclass(frozen=True)
class OutputStatus:
    """An output.

    Attributes
    ----------
    wire : str
        Name of the protocol, such as ``"zeromq"``.
    target : str
        Receiver, or the addresses that clients connect to.
    sent, bytes : int
        Messages sent so far, and their size; over ZeroMQ, a message counts once, however many clients receive it.
    skipped : int or None
        Messages replaced by newer ones, or dropped, before they were sent; None if the wire cannot count them.
    failed : int
        Messages that could not be sent.
    clients : int or None
        Clients that are connected now; None for a wire that has none, or whose clients are those of `ClientsStatus`.
    refused : int
        Connections refused so far; 0 for such a wire.
    """

    wire: str
    target: str
    sent: int
    bytes: int
    skipped: int | None
    failed: int
    clients: int | None = None
    refused: int = 0


@dataclass(frozen=True)
class TimelineSound:
    """The sound of a take: the name of its file, and the second of the timeline of its first sample."""

    file: str
    at: float


@dataclass(frozen=True)
class TimelineTake:
    """A take that plays on a character: its second on the timeline, its duration in seconds, and its sound."""

    character: str
    take: str
    at: float
    seconds: float
    sound: TimelineSound | None = None


@dataclass(frozen=True)
class TimelineStatus:
    """The timeline of the takes that play.

    Attributes
    ----------
    position, start, end : float
        Seconds.
    moment : float
        Time of `position`, in seconds of the service's monotonic clock; takes that wait for a count-in begin then.
    speed : float
        Seconds of the timeline per second.
    paused, loop : bool
    takes : sequence of TimelineTake
    """

    position: float
    moment: float
    start: float
    end: float
    speed: float
    paused: bool
    loop: bool
    takes: Sequence[TimelineTake]


@dataclass(frozen=True)
class ClipStatus:
    """The film of a kiosk's visitor: its code, and the seconds until it is deleted, None while it is made."""

    code: str
    seconds_left: int | None


@dataclass(frozen=True)
class Status:
    """The whole status; `timeline` is None if no take plays."""

    service: ServiceStatus
    stages: Sequence[StageStatus]
    characters: Sequence[CharacterStatus]
    clients: ClientsStatus
    outputs: Sequence[OutputStatus]
    timeline: TimelineStatus | None = None
    clips: list[ClipStatus] = field(default_factory=list)

    @property
    def performing(self) -> int:
        """Number of characters that a performer drives."""
        return sum(character.state == "performing" for character in self.characters)

    def as_json(self) -> dict[str, Any]:
        """Return the status as dicts, lists and numbers, with the names of the attributes as keys."""
        return asdict(self)
