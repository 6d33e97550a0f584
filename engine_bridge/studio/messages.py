"""The messages of the WebSocket ``/api``: requests, their results, and what the server pushes.

The client's first text frame is `Hello`. The server answers with `Greeting`, then with an event `StateEvent`, or closes
the connection with one of the `CloseCode`. From then on, the client sends requests, one flat or nested JSON map each::

    {"id": 7, "do": "edit", "character": "dragon", "puppet": {…}}

`id` is an integer that the reply repeats. The reply is one of these::

    {"id": 7, "ok": true, "result": {…}}
    {"id": 7, "ok": false, "error": {"where": "…", "found": "…", "expected": "…", "fix": "…"}}

Between replies, the server pushes events, which have the key ``event`` instead of ``id``. Replies come in the order in
which the work ends. Unknown keys of a request are errors. Clients ignore keys that they do not know.

Points are in the coordinates of the mesh file, as in the puppet file. Names of joints are those of
`capture.skeleton.JOINTS`. Characters have names of up to 32 letters, digits, `_` and `-`.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat

from engine_bridge.performance.settings import Form
from puppetline.toml_schema import Table

MAX_REQUEST_BYTES = 1_000_000
"""Maximum size of a request in bytes. The largest is `Edit`; 64 limbs take about 50,000 bytes."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
"""Name of a character, stage or take."""

Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
"""Id of an upload, a file or a job."""

Seconds = Annotated[FiniteFloat, Field(ge=0, le=86_400)]


class CloseCode(IntEnum):
    """Why the server closes a WebSocket."""

    NOT_UNDERSTOOD = 4400
    """The first frame is not `Hello`, or frame after frame is not understood."""
    REFUSED = 4401
    """The token is wrong, or a one-time token that was used before. Open the address that the terminal shows."""
    TOO_SLOW = 4408
    """More replies wait for this client than the server keeps. Connect again."""
    NO_SERVICE = 4503
    """Of ``/stream``: the service is not running, or has ended. Connect again in a second."""


# ---------------------------------------------------------------------------------------------------- the beginning


class Hello(Table):
    """First frame of ``/api`` and of ``/stream``: a token.

    ``/api`` accepts a one-time token (from the address, after ``#token=``), a session token, or the token of the
    file that the server was started with. ``/stream``, ``POST /uploads`` and ``GET /files/ID`` accept session tokens
    only; the last two as the header ``Authorization: Bearer TOKEN``.
    """

    token: str


class Greeting(Table):
    """Answer to `Hello`, under the key ``hello``: ``{"hello": {…}}``.

    Attributes
    ----------
    session : str
        Session token, to keep in sessionStorage. It stays valid until the server ends.
    version : str
        Version of Puppetline.
    joints : list of str
        Names of all joints, in the order of arrays of joints.
    parents : dict
        Each joint's parent in the performer's skeleton; the root is not in it.
    forms : list of str
        Values of `Export.form`.
    suffixes : dict
        Endings of file names by kind of upload, for the file chooser: ``{"character": [".glb", …], …}``. The kind of an
        upload is detected from its content.
    limits : dict
        ``upload_bytes``, ``uploads``: maximum size of an upload, and maximum number of uploads.
    joined : bool
        Whether the studio has joined a service that it did not start: its characters and source cannot be changed.
    """

    session: str
    version: str
    joints: list[str]
    parents: dict[str, str]
    forms: list[str]
    suffixes: dict[str, list[str]]
    limits: dict[str, int]
    joined: bool


# ------------------------------------------------------------------------------------------------------------ state


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
    """What performs: its URI (empty for none), its kind, a text for people, and seconds at which it begins and ends."""

    uri: str = ""
    kind: Literal["none", "example", "upload", "take", "live"] = "none"
    name: str = ""
    text: str = ""
    loop: bool = False
    start: float | None = None
    stop: float | None = None


class StageState(Table):
    """A stage: skeletons per second, packets refused by reason, and the name of the take that is being recorded."""

    name: str
    source: str
    rate: float
    refused: dict[str, int]
    recording: str | None


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
        Whether it is being started or started again.
    address : str
        Address of its control socket; empty while it does not run.
    restarts : int
        How often it has ended without being asked to.
    problem : str
        Why it does not run, or why it ended last; empty if nothing is wrong.
    """

    running: bool = False
    starting: bool = False
    address: str = ""
    restarts: int = 0
    problem: str = ""


class UploadState(Table):
    """An uploaded file: its kind, and what `puppetline inspect` says of it."""

    upload: str
    name: str
    kind: Literal["character", "log", "puppet"]
    bytes: int
    facts: dict[str, Any]


class TakeState(Table):
    """A take: seconds from its first frame to its last (None while it is being recorded), bytes, time of writing."""

    name: str
    seconds: float | None
    frames: int
    bytes: int
    written: float


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
    """Numbers of the service over the last second.

    `fps` is the skeletons per second of all stages, `latency_ms` the median time from a skeleton to its frame,
    `clients` the clients of the stream, and `drops` the skeletons and frames that newer ones have replaced so far.
    """

    fps: float = 0.0
    latency_ms: float | None = None
    clients: int = 0
    drops: int = 0


class Banner(Table):
    """The most important thing to know now, in plain words, and what to do."""

    level: Literal["none", "info", "warning", "error"] = "none"
    text: str = ""
    fix: str = ""


class State(Table):
    """Everything that the page shows and that is not in a reply; sent whole whenever it changes."""

    characters: Sequence[CharacterState] = ()
    source: SourceState = SourceState()
    stages: Sequence[StageState] = ()
    service: ServiceState = ServiceState()
    performers: Sequence[PerformerState] = ()
    recording: str | None = None
    takes: Sequence[TakeState] = ()
    uploads: Sequence[UploadState] = ()
    files: Sequence[FileState] = ()
    jobs: Sequence[JobState] = ()
    status: StatusState = StatusState()
    banner: Banner = Banner()


class StateEvent(Table):
    """``{"event": "state", "state": {…}}``: the state has changed; pushed at most ten times per second."""

    event: Literal["state"] = "state"
    state: State


class ProgressEvent(Table):
    """``{"event": "progress", …}``: a job has advanced; `JobState` of the next state has the same."""

    event: Literal["progress"] = "progress"
    job: str
    text: str
    fraction: float


# ---------------------------------------------------------------------------------------------------------- uploads


class UploadReply(Table):
    """Answer to ``POST /uploads?name=FILE`` with the file as the body; status 200.

    A refused upload has status 400, 401, 403, 413 or 507, and the body ``{"error": {where, found, expected, fix}}``.
    """

    upload: str
    kind: Literal["character", "log", "puppet"]
    name: str
    facts: dict[str, Any]


# --------------------------------------------------------------------------------------------------------- requests


class Request(Table):
    """A request; `id` and `do` are in every one."""

    id: int


class Ping(Request):
    """Result: ``"pong"``."""

    do: Literal["ping"]


class GetState(Request):
    """Result: `State`. It is pushed on every change, so this is for tests and for programs without events."""

    do: Literal["state"]


class Invite(Request):
    """Make another one-time token, for a second browser. Result: ``{"address": "http://127.0.0.1:7480/#token=…"}``."""

    do: Literal["invite"]


class OpenCharacter(Request):
    """Propose a puppet for an uploaded mesh and put it on the stage; a job, see `JobResult`.

    `up`, `front` and `scale` are as in the puppet file; None to find them. `limbs` false proposes handles. If no source
    performs, the example performer starts, so that the character moves.

    Result: `JobResult` with ``{"character": name}``.
    """

    do: Literal["open_character"]
    upload: Id
    up: str | None = None
    front: str | None = None
    scale: float | None = None
    limbs: bool = True
    mirror: bool = False


class OpenPuppet(Request):
    """Open an uploaded puppet file with its mesh: an upload too, or by default the one with the name in the file.

    Result: `JobResult` with ``{"character": name}``.
    """

    do: Literal["open_puppet"]
    upload: Id
    mesh: Id | None = None


class OpenExample(Request):
    """Open an example character, of `Sources.characters`. Result: `JobResult` with ``{"character": name}``."""

    do: Literal["open_example"]
    name: Name


class CloseCharacter(Request):
    """Take a character off the stage; unsaved edits are lost. Result: ``{}``."""

    do: Literal["close_character"]
    character: Name


class JobResult(Table):
    """Result of a request that starts a job and waits for it: the job's id, and its own keys.

    The job is in `State.jobs` with its progress as long as it runs. The reply comes when it is done; it is an error
    reply if it has failed or was cancelled.
    """

    job: str


class Source(Request):
    """Choose what performs: exactly one of `uri`, `upload`, `example`, `take`. Result: `SourceState`.

    `uri` is a live source: ``osc:7110``, ``vmc:39539``, ``freenect:``, ``openni:…`` or ``camera:0``. Recordings are
    chosen by upload, example or take; they play in a loop unless `loop` is false, from second `start` to `stop`.
    """

    do: Literal["source"]
    uri: str | None = None
    upload: Id | None = None
    example: Name | None = None
    take: Name | None = None
    loop: bool = True
    start: Seconds | None = None
    stop: Seconds | None = None


class GetSources(Request):
    """List what could perform. Result: `Sources`. It takes about two seconds, in which ports are listened to."""

    do: Literal["sources"]


class Port(Table):
    """A port where skeletons of another program may arrive.

    `uri` opens it. `arriving` are performers seen in about a second, `refused` the packets that were not understood, by
    reason, and `problem` says why the port cannot be listened to.
    """

    uri: str
    text: str
    arriving: int = 0
    rate: float = 0.0
    refused: dict[str, int] = Field(default_factory=dict)
    problem: str = ""


class Device(Table):
    """A sensor or camera, or a library that reads one: `Finding` of `puppetline doctor`, and the URI that opens it."""

    name: str
    ok: bool | None
    detail: str
    fix: str
    uri: str


class Sources(Table):
    """What could perform.

    Attributes
    ----------
    characters : list of str
        Names for `OpenExample`.
    examples : list of str
        Names for `Source.example`.
    devices : list of Device
    ports : list of Port
    """

    characters: list[str]
    examples: list[str]
    devices: list[Device]
    ports: list[Port]


class GetPuppet(Request):
    """Result: `PuppetReply`."""

    do: Literal["puppet"]
    character: Name


class PuppetReply(Table):
    """A whole puppet.

    Attributes
    ----------
    character : str
    puppet : dict
        All tables of `engine_bridge.puppet.puppet.Puppet` with all keys: ``character`` (``mesh`` is a file name),
        ``limb`` (``name``, ``points``, ``joints``, ``follow``, ``gain``, ``parent``), ``handle`` (``name``,
        ``position``, ``joint``, ``joints``, ``axes``, ``gain``), ``root`` or None, ``retarget`` (``mirror``, ``scale``,
        ``arm_space``, ``hands_meet``), ``smoothing`` (``max_deviation`` None for infinity) and ``solver``.
    saved : bool
        As in `CharacterState`.
    """

    character: str
    puppet: dict[str, Any]
    saved: bool


class Edit(Request):
    """Replace a puppet with another one of the same mesh, while it performs. Result: `PuppetReply`.

    `puppet` is as in `PuppetReply`; omitted keys have their defaults, and ``character.mesh`` is ignored. A mapping is
    applied at once. Other points of limbs, or other handles, take a second to compute for a large mesh; the character
    moves as before until then, and the reply comes after it.
    """

    do: Literal["edit"]
    character: Name
    puppet: dict[str, Any]


class Snap(Request):
    """Find the surface point and the point inside the character next to a point. Result: `SnapReply`."""

    do: Literal["snap"]
    character: Name
    point: tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class SnapReply(Table):
    """Nearest point of the surface, the point in the middle of the character below it, and half the thickness there."""

    surface: tuple[float, float, float]
    centre: tuple[float, float, float]
    radius: float


class MirrorLimb(Request):
    """Make the other side's limb or handle from one: names and joints swap left and right, points are mirrored.

    Points are mirrored at the character's plane of symmetry, and limbs keep their follow and gain. An existing limb or
    handle of the other side's name is replaced. Result: `PuppetReply`; its puppet is not applied: send it as `Edit`.
    """

    do: Literal["mirror_limb"]
    character: Name
    name: str


class SavePuppet(Request):
    """Save the puppet: into the file that was opened, with its comments and order. Result: `SaveReply`."""

    do: Literal["save_puppet"]
    character: Name


class SaveReply(Table):
    """A saved puppet file: its name, and the id to download it."""

    character: str
    name: str
    file: str


class RevertPuppet(Request):
    """Return to the puppet as it was opened or last saved. Result: `PuppetReply`."""

    do: Literal["revert_puppet"]
    character: Name


class RecordStart(Request):
    """Begin a take of what performs now. `name` by default has the time. Result: ``{"take": name}``."""

    do: Literal["record_start"]
    name: Name | None = None


class RecordStop(Request):
    """End the take. Result: `TakeState`."""

    do: Literal["record_stop"]


class DeleteTake(Request):
    """Delete a take. Result: ``{}``."""

    do: Literal["delete_take"]
    take: Name


class DeleteUpload(Request):
    """Delete an upload that nothing uses. Result: ``{}``."""

    do: Literal["delete_upload"]
    upload: Id


class Export(Request):
    """Convert a recording for a character: exactly one of `take`, `upload`, `example`; as `puppetline convert` does.

    `form` is the value of ``--as``. `start` and `stop` trim the recording, in seconds from its beginning. A job, see
    `JobResult`. Result: `ExportReply`.
    """

    do: Literal["export"]
    character: Name
    take: Name | None = None
    upload: Id | None = None
    example: Name | None = None
    form: Form = "morph"
    start: Seconds | None = None
    stop: Seconds | None = None


class ExportReply(JobResult):
    """An exported .glb.

    `numbers` is `engine_bridge.export.convert.Summary`, and `text` the lines that `puppetline convert` prints.
    """

    file: str
    name: str
    numbers: dict[str, Any]
    text: str


class Cancel(Request):
    """Cancel a job; the request that started it gets an error. Result: ``{}``."""

    do: Literal["cancel"]
    job: Id


class Calibrate(Request):
    """Map the performer's present pose to the character's rest pose. Result: ``{}``."""

    do: Literal["calibrate"]
    character: Name


class Mirror(Request):
    """Turn mirroring on or off until the service ends; `Edit` of ``retarget.mirror`` keeps it. Result: ``{}``."""

    do: Literal["mirror"]
    character: Name
    on: bool


class ChooseUser(Request):
    """Assign a performer to a character; None lets the service choose. Result: ``{}``."""

    do: Literal["choose_user"]
    character: Name
    user: Annotated[int, Field(ge=0, le=2**31 - 1)] | None


class SmoothingPreview(Request):
    """Compute what a smoothing does to a joint. Result: `SmoothingReply`."""

    do: Literal["smoothing_preview"]
    alpha: FiniteFloat
    gamma: FiniteFloat
    jitter_radius: FiniteFloat
    max_deviation: FiniteFloat | None
    prediction: FiniteFloat


class SmoothingReply(Table):
    """The effect of a smoothing at 30 Hz.

    Attributes
    ----------
    times : list of float
        Seconds.
    measured, smoothed : list of float
        Metres: a joint at rest with noise of 5 mm, then a step of 0.3 m, then rest again.
    jitter_mm : float
        Noise that is left of 5 mm (standard deviation).
    lag_ms : float
        Lag behind a joint that moves at 1 m/s; negative if the result runs ahead.
    rise_ms : float or None
        Time until 90 % of a step of 0.3 m; None if that is not reached within 10 s.
    overshoot_mm : float
        Overshoot after that step.
    """

    times: list[float]
    measured: list[float]
    smoothed: list[float]
    jitter_mm: float
    lag_ms: float
    rise_ms: float | None
    overshoot_mm: float


class Look(Request):
    """Say what the source delivers, and why nothing moves. Result: `LookReply`."""

    do: Literal["look"]


class LookReply(Table):
    """What the source delivers.

    `problems` are sentences with what to do, and `performers` is one line about each. `picture` is for a JPEG in
    base64; it is empty, because a sensor's picture does not leave the service.
    """

    picture: str
    problems: list[Banner]
    performers: list[str]


REQUESTS: dict[str, type[Request]] = {
    "ping": Ping,
    "state": GetState,
    "invite": Invite,
    "open_character": OpenCharacter,
    "open_puppet": OpenPuppet,
    "open_example": OpenExample,
    "close_character": CloseCharacter,
    "source": Source,
    "sources": GetSources,
    "puppet": GetPuppet,
    "edit": Edit,
    "snap": Snap,
    "mirror_limb": MirrorLimb,
    "save_puppet": SavePuppet,
    "revert_puppet": RevertPuppet,
    "record_start": RecordStart,
    "record_stop": RecordStop,
    "delete_take": DeleteTake,
    "delete_upload": DeleteUpload,
    "export": Export,
    "cancel": Cancel,
    "calibrate": Calibrate,
    "mirror": Mirror,
    "choose_user": ChooseUser,
    "smoothing_preview": SmoothingPreview,
    "look": Look,
}
"""Every request that the server carries out, by its `do`. Requests above that are not listed here are refused."""
