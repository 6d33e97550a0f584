"""The state that all pages show, the events that carry it, and uploads."""

from collections.abc import Sequence
from typing import Any, Literal

from engine_bridge.service.monitoring.status import TimelineStatus
from engine_bridge.studio.messages.film import FilmState
from puppetline.toml_schema import Table


class CharacterState(Table):
    """A character.

    Attributes
    ----------
    name : str
        Name in requests and topics.
    title : str
        File name of its mesh or puppet file, for people.
    stage : str
        Stage that it is on; empty before it is streamed.
    limbs, handles : list of str
        Names.
    targets : list of str
        Names of the morph targets that the mesh has.
    vertices, triangles : int
    version : str
        Changes with every edit of the puppet; pages then request it again.
    saved : bool
        Whether the puppet is as it was opened or last saved.
    model : str
        Id for ``GET /files/ID``: the character at rest as a .glb for the shader (`puppetline shader-mesh`), with its
        materials and textures. It changes if the isoline coordinates change. Empty for a character of a service that
        was joined, and for one that no shader can draw: the scene message has its geometry.
    notes : list of str
        Sentences about what the proposal assumed, and what is unclear.
    performer : int or None
        User number.
    state : str
        ``"waiting"``, ``"calibrating"``, ``"performing"`` or ``"leaving"``.
    mirror : bool
        Whether the performer's left moves the character's right.
    rate : float
        Frames sent per second.
    """

    name: str
    title: str
    stage: str = ""
    limbs: Sequence[str] = ()
    handles: Sequence[str] = ()
    targets: Sequence[str] = ()
    vertices: int = 0
    triangles: int = 0
    version: str = ""
    saved: bool = True
    model: str = ""
    notes: Sequence[str] = ()
    performer: int | None = None
    state: str = "waiting"
    mirror: bool = False
    rate: float = 0.0


class SourceState(Table):
    """The source: its URI (empty for none), its kind, its name, a text for people, and how a recording is played.

    `start` and `stop` are the seconds of the recording at which it begins and ends; None for the whole recording.
    """

    uri: str = ""
    kind: Literal["none", "example", "upload", "take", "live"] = "none"
    name: str = ""
    text: str = ""
    loop: bool = False
    start: float | None = None
    stop: float | None = None


class StageState(Table):
    """A stage.

    Attributes
    ----------
    rate : float
        Skeletons per second.
    refused : dict
        Packets that were not understood, by reason.
    recording : str or None
        Name of the take that is being recorded.
    count_in : int
        Seconds until a take begins, rounded up; 0 without a count-in.
    """

    name: str
    source: str
    rate: float
    refused: dict[str, int]
    recording: str | None
    count_in: int = 0


class PerformerState(Table):
    """A performer in view; see `engine_bridge.service.monitoring.status.UserStatus`."""

    user: int
    stage: str
    state: str
    character: str | None
    distance: float
    height: float | None


class ServiceState(Table):
    """The service.

    Attributes
    ----------
    running : bool
        Whether it streams.
    starting : bool
        Whether it is being started or restarted.
    address : str
        Address of its control socket; empty while it does not run.
    restarts : int
        Number of times that it has ended unexpectedly.
    problem : str
        Why it does not run; empty if nothing is wrong.
    text : str
        What its start is waiting for, as a sentence; empty otherwise.
    """

    running: bool = False
    starting: bool = False
    address: str = ""
    restarts: int = 0
    problem: str = ""
    text: str = ""


UploadKind = Literal["character", "log", "puppet", "video", "sound", "picture"]


class UploadReply(Table):
    """The reply to ``POST /uploads``: id, kind, name, and what `puppetline inspect` reports.

    A sound or a picture becomes a file of the film: it has no id, and `file` is its path in the scene file.
    """

    upload: str
    kind: UploadKind
    name: str
    facts: dict[str, Any]
    file: str = ""


class UploadState(Table):
    """An uploaded file: its kind, and what `puppetline inspect` reports about it."""

    upload: str
    name: str
    kind: UploadKind
    bytes: int
    facts: dict[str, Any]


class TakeState(Table):
    """A take.

    Attributes
    ----------
    seconds : float or None
        From its first frame to its last; None if unknown.
    written : float
        Time of writing.
    at : float or None
        Second of the film at which it was recorded over other takes.
    parts : list of str
        Characters that a performer drives in it when it begins.
    picture : str
        Id for ``GET /files/ID``: images of a character in it, side by side. Empty until it is drawn.
    wave : str
        The same for the wave form of its sound, whose white part is the sound. Empty without sound.
    sound : bool
        Whether there is a sound beside it.
    sound_file : str
        Id of its sound, a .wav. Empty without sound, and for a take of a service that was joined.
    """

    name: str
    seconds: float | None
    frames: int
    bytes: int
    written: float
    at: float | None = None
    parts: Sequence[str] = ()
    picture: str = ""
    wave: str = ""
    sound: bool = False
    sound_file: str = ""


class FileState(Table):
    """A file to download with ``GET /files/ID``."""

    file: str
    name: str
    bytes: int
    kind: Literal["export", "puppet", "take"]


class JobState(Table):
    """Long work.

    Attributes
    ----------
    job : str
    title : str
        What it does, for people: ``"Export of take-1 as morph"``.
    text : str
        Present step.
    fraction : float
        Share of the step that is done, 0 to 1.
    state : str
        ``"running"``, ``"done"``, ``"failed"`` or ``"cancelled"``.
    result : dict or None
        Result of the request that started it, if done.
    error : dict or None
        ``where``, ``found``, ``expected`` and ``fix``, if failed.
    """

    job: str
    title: str
    text: str = ""
    fraction: float = 0.0
    state: Literal["running", "done", "failed", "cancelled"] = "running"
    result: dict[str, Any] | None = None
    error: dict[str, str] | None = None


class StatusState(Table):
    """Numbers of the service's last status.

    `fps` is the skeletons per second of all stages, and `latency_ms` the median time from a skeleton to its frame on
    the slowest stage, both over ten seconds. `clients` is the number of clients of the stream, and `drops` that of
    skeletons and frames that newer ones have replaced so far.
    """

    fps: float = 0.0
    latency_ms: float | None = None
    clients: int = 0
    drops: int = 0


class Banner(Table):
    """The most important message for the user now, and what to do."""

    level: Literal["none", "info", "warning", "error"] = "none"
    text: str = ""
    fix: str = ""


class State(Table):
    """Everything that the page shows and that is not in a reply; sent whole whenever it changes.

    `installed` has the extras that are installed, of those that `Install` can install. `microphone` tells whether sound
    is recorded with takes.
    """

    characters: Sequence[CharacterState] = ()
    source: SourceState = SourceState()
    stages: Sequence[StageState] = ()
    service: ServiceState = ServiceState()
    performers: Sequence[PerformerState] = ()
    recording: str | None = None
    takes: Sequence[TakeState] = ()
    film: FilmState = FilmState()
    installed: Sequence[str] = ()
    microphone: bool = False
    timeline: TimelineStatus | None = None
    uploads: Sequence[UploadState] = ()
    files: Sequence[FileState] = ()
    jobs: Sequence[JobState] = ()
    status: StatusState = StatusState()
    banner: Banner = Banner()


class ProgressEvent(Table):
    """``{"event": "progress", …}``: a job has advanced; its `JobState` in the next state has the same values."""

    event: Literal["progress"] = "progress"
    job: str
    text: str
    fraction: float
