"""The messages of the WebSocket ``/api``: requests, their results, and events that the server pushes.

The client's first text frame is `Hello`. The server answers with `Greeting` and a `StateEvent`, or closes the
connection with a `CloseCode`. From then on, the client sends requests, each of which is a JSON map::

    {"id": 7, "do": "edit", "character": "dragon", "puppet": {…}}

`id` is an integer that the reply repeats. The reply is one of these::

    {"id": 7, "ok": true, "result": {…}}
    {"id": 7, "ok": false, "error": {"where": "…", "found": "…", "expected": "…", "fix": "…"}}

Between replies, the server pushes events, which have the key ``event`` instead of ``id``. Replies come in the order in
which the work ends. Unknown keys of a request are errors. Clients ignore keys that they do not know.

Points are in the coordinates of the mesh file, as in the puppet file. Names of joints are those of
`capture.skeleton.JOINTS`. Characters have names of up to 32 letters, digits, `_` and `-`.
"""

from engine_bridge.studio.messages.base import MAX_REQUEST_BYTES, Id, JobResult, Name, Request, Seconds
from engine_bridge.studio.messages.characters import (
    ChangePlan,
    CloseCharacter,
    DeleteUpload,
    Edit,
    GetPuppet,
    MirrorLimb,
    OpenCharacter,
    OpenExample,
    OpenPuppet,
    PuppetReply,
    RevertPuppet,
    SavePuppet,
    SaveReply,
    Snap,
    SnapReply,
)
from engine_bridge.studio.messages.connection import CloseCode, GetState, Greeting, Hello, Invite, Ping
from engine_bridge.studio.messages.film import EditFilm, FilmReply, FilmState, Install, MakeFilm, PlayFilm
from engine_bridge.studio.messages.performers import (
    Calibrate,
    ChooseUser,
    Device,
    GetSources,
    Look,
    LookReply,
    Mirror,
    Port,
    SeenPerformer,
    SmoothingPreview,
    SmoothingReply,
    Source,
    Sources,
)
from engine_bridge.studio.messages.state import (
    Banner,
    CharacterState,
    ClipState,
    FileState,
    JobState,
    PerformerState,
    ProgressEvent,
    ServiceState,
    SourceState,
    StageState,
    State,
    StateEvent,
    StatusState,
    TakeState,
    TimelineState,
    TimelineTake,
    UploadReply,
    UploadState,
)
from engine_bridge.studio.messages.takes import (
    Cancel,
    DeleteTake,
    Export,
    ExportReply,
    Microphone,
    Pause,
    RecordStart,
    RecordStop,
    Seek,
    Stop,
)

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
    "change_plan": ChangePlan,
    "save_puppet": SavePuppet,
    "revert_puppet": RevertPuppet,
    "record_start": RecordStart,
    "record_stop": RecordStop,
    "microphone": Microphone,
    "pause": Pause,
    "seek": Seek,
    "stop": Stop,
    "edit_film": EditFilm,
    "play_film": PlayFilm,
    "make_film": MakeFilm,
    "install": Install,
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
"""Every request that the server accepts, by its `do`."""
