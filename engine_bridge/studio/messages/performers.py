"""Requests about performers: sources, what they see, calibration and smoothing."""

from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from engine_bridge.puppet.puppet import JointName
from engine_bridge.studio.messages.base import Id, Name, Request, Seconds
from engine_bridge.studio.messages.state import Banner
from puppetline.toml_schema import Table


class Source(Request):
    """Choose the source: exactly one of `uri`, `upload`, `example`, `take`. Result: `SourceState`.

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
    """List the available sources, which takes about two seconds. Result: `Sources`."""

    do: Literal["sources"]


class Port(Table):
    """A port where skeletons of another program may arrive.

    `uri` opens it. `arriving` is the number of performers tracked within about a second, `rate` their skeletons per
    second, and `refused` the number of packets that were not understood, by reason. `problem` is the reason if the port
    cannot be opened.
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
    """The available sources, and the example characters.

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


class Calibrate(Request):
    """Map the performer's present pose to the character's rest pose. Result: that of the service."""

    do: Literal["calibrate"]
    character: Name


class ChooseUser(Request):
    """Assign a performer to a character; None lets the service choose. Result: that of the service."""

    do: Literal["choose_user"]
    character: Name
    user: Annotated[int, Field(ge=0, le=2**31 - 1)] | None


class Look(Request):
    """Report what the source of a stage, by default the first, delivers, and why nothing moves. Result: `LookReply`."""

    do: Literal["look"]
    stage: Name | None = None


class SeenPerformer(Table):
    """A performer in view of a source.

    `text` is a line about how well the performer is tracked. `joints` are x and y of the 20 joints as shares of the
    image's width and height, None for joints that are lost; it is None without an image.
    """

    user: int
    text: str
    joints: list[tuple[float, float] | None] | None


class LookReply(Table):
    """What a source delivers.

    `picture` is a JPEG in base64, of `width` times `height` pixels before it was reduced; it is empty for a source
    without images. `problems` are sentences with what to do, the most important first.
    """

    picture: str
    width: int
    height: int
    problems: list[Banner]
    performers: list[SeenPerformer]


class SmoothingPreview(Request):
    """Compute the effect of smoothing settings on a joint. Result: `SmoothingReply`.

    With `joint` and `character`, the input is this joint of the performer who moves the character, in the last three
    seconds as the source delivers it; without a performer, the reply is an error. Otherwise, it is a test signal.
    """

    do: Literal["smoothing_preview"]
    alpha: FiniteFloat
    gamma: FiniteFloat
    jitter_radius: FiniteFloat
    max_deviation: FiniteFloat | None
    prediction: FiniteFloat
    joint: JointName | None = None
    character: Name | None = None


class SmoothingReply(Table):
    """The effect of smoothing settings.

    Attributes
    ----------
    times : list of float
        Seconds.
    measured, smoothed : list of float
        Metres. The test signal is a joint at rest with noise of 5 mm, then a step of 0.3 m, then rest again, at 30 Hz.
        Of a live joint, it is the axis along which it moves most.
    measured_mm, jitter_mm : float
        Noise before and after (standard deviation).
    lag_ms : float or None
        Lag behind a joint that moves at 1 m/s; negative if the result runs ahead. Of a live joint, the shift at which
        the smoothed motion fits the measured one best; None if the joint does not move.
    rise_ms : float or None
        Time until 90 % of a step of 0.3 m; None if that is not reached within 10 s, and for a live joint.
    overshoot_mm : float or None
        Overshoot after that step; None for a live joint.
    """

    times: list[float]
    measured: list[float]
    smoothed: list[float]
    measured_mm: float
    jitter_mm: float
    lag_ms: float | None
    rise_ms: float | None
    overshoot_mm: float | None
