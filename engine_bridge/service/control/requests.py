"""The requests of the control socket, and the encoding of requests and replies (docs/control.md).

A request is one flat map, in JSON or msgpack: ``{"do": "calibrate", "id": 7, "character": "dog"}``.
"""

import contextlib
import difflib
import json
import re
from collections.abc import Collection
from typing import Annotated, Any, Literal

import msgpack
from pydantic import AfterValidator, BeforeValidator, Field, FiniteFloat, StrictBool

from capture.skeleton import JOINTS
from engine_bridge.puppet.puppet import AxisSet, JointName, Number, Scale
from puppetline.errors import PuppetlineError, ServiceError
from puppetline.toml_schema import Table, mistake

Encoding = Literal["json", "msgpack"]
RequestId = int | str | None

WHERE = "the request"
MAX_REQUEST_BYTES = 65_536
MAX_KEYS = 16
MAX_EXACT_INTEGER = 2**53
MAX_QUOTED_CHARACTERS = 500
"""Maximum length of each string of an error reply, which may quote a request."""

NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
SCALARS = (str, int, float, bool, type(None))
MSGPACK_MAPS = frozenset([*range(0x80, 0x90), 0xDE, 0xDF])


def _plain_name(name: str) -> str:
    """Refuse paths: a name may become that of a file in the folder of takes."""
    if not NAME.fullmatch(name):
        raise mistake(
            found=repr(name), expected="a name of 1 to 64 letters (a to z), digits, _ and -", fix="Choose such a name."
        )
    return name


def _joint_names(value: Any) -> Any:
    """Split a string into names, because a request has no lists."""
    if value is None:
        return ()
    if not isinstance(value, str):
        raise mistake(
            found=repr(value),
            expected="names of joints separated by spaces, or null",
            fix="Write for example 'wrist_left hand_left'.",
        )
    return tuple(value.split())


def _values(text: Any) -> Any:
    """Read a map in JSON, because a request has no nested values."""
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        values = json.loads(text, parse_float=_number)
        if isinstance(values, dict):
            return values
    raise mistake(
        found=repr(text)[:60],
        expected="the tables of a puppet file as a JSON string",
        fix='Ask for the present one with {"do": "puppet"}, change it, and send it back.',
    )


def _number(text: str) -> int | float:
    """Read a number with a decimal point; 8.0 becomes an integer, because some clients write integers so."""
    value = float(text)
    return int(value) if value.is_integer() and abs(value) <= MAX_EXACT_INTEGER else value


PuppetValues = Annotated[dict[str, Any], BeforeValidator(_values)]
Second = Annotated[FiniteFloat, Field(strict=True, ge=-86_400, le=86_400)]
Name = Annotated[str, Field(strict=True), AfterValidator(_plain_name)]
Joints = Annotated[tuple[JointName, ...], Field(max_length=len(JOINTS)), BeforeValidator(_joint_names)]
User = Annotated[int, Field(strict=True, ge=0, le=2**31 - 1)]


class Nothing(Table):
    """No arguments."""


class ChooseUser(Table):
    """Assign a performer to a character; null lets the service choose."""

    character: Name
    user: User | None


class Mirror(Table):
    """Turn mirroring on or off; if it is on, the performer's left moves the character's right."""

    character: Name
    on: Annotated[bool, Field(strict=True)]


class OneCharacter(Table):
    """A character."""

    character: Name


class SetPuppet(Table):
    """Change a character's puppet.

    `puppet` is JSON: tables of a puppet file, as in the reply to `puppet`. Omitted tables and keys stay as they are; a
    list, such as ``handle``, is replaced as a whole. ``character.mesh`` is ignored.
    """

    character: Name
    puppet: PuppetValues


class SetHandle(Table):
    """Change the joints that move a handle, its axes or its gain; omitted keys stay unchanged.

    Like `SetRoot` and `SetScale`, it is for clients of version 0.1; `SetPuppet` replaces them.
    """

    character: Name
    handle: Annotated[str, Field(strict=True, min_length=1)]
    joints: Joints = ()
    axes: AxisSet = "xyz"
    gain: Number = 1.0


class SetRoot(Table):
    """Change the joint of the root motion; null turns it off, and omitted keys stay unchanged."""

    character: Name
    joint: JointName | None
    axes: AxisSet = "xz"
    turns: StrictBool = True
    feet: Literal["lock", "free"] = "lock"


class SetScale(Table):
    """Set how many metres the character moves per metre of the performer."""

    character: Name
    scale: Scale


class RecordStart(Table):
    """Record a stage, after a count-in in seconds; its name may be omitted if it is the only one."""

    name: Name | None = None
    stage: Name | None = None
    count_in: Annotated[int, Field(strict=True, ge=0, le=30)] = 0


class LoadTake(Table):
    """Compute a character's motion in a take, so that it can be played at once.

    `part` is the character in the take whose performer drives it, by default the one of the same name.
    """

    character: Name
    take: Name
    part: Name | None = None


class PlayTake(LoadTake):
    """Play a take on a character.

    `at` is the second of the timeline at which the take begins, by default the one at which it was recorded. `start`
    and `stop` trim the take; `beside` keeps the character's other takes. With `pause`, the timeline stands until it
    goes on, if no other take plays.
    """

    at: Second | None = None
    start: Second = 0.0
    stop: Second | None = None
    beside: StrictBool = False
    pause: StrictBool = False


class Switch(Table):
    """Turn something on or off."""

    on: StrictBool = True


class Seek(Table):
    """Jump to a second of the timeline."""

    seconds: Second


class Speed(Table):
    """Set the seconds of the timeline per second."""

    factor: Annotated[FiniteFloat, Field(strict=True, ge=0.1, le=4)]


class Stop(Table):
    """Stop the take of a character, or all takes."""

    character: Name | None = None


class OneStage(Table):
    """A stage; its name may be omitted if it is the only one."""

    stage: Name | None = None


class Trace(Table):
    """A joint of the performers of a stage; the stage may be omitted if it is the only one."""

    joint: JointName
    stage: Name | None = None


def encoding_of(body: bytes) -> Encoding:
    """Return the encoding of a request, which its first byte shows; its reply has the same."""
    return "msgpack" if body[:1] and body[0] in MSGPACK_MAPS else "json"


def decode(body: bytes, encoding: Encoding) -> dict[str, Any]:
    """Read a request: a map from strings to strings, numbers, booleans and null.

    Raises
    ------
    ServiceError
    """
    if len(body) > MAX_REQUEST_BYTES:
        raise _not_a_request(f"{len(body)} bytes", f"no more than {MAX_REQUEST_BYTES}")
    try:
        if encoding == "msgpack":
            values = msgpack.unpackb(
                body,
                raw=False,
                strict_map_key=True,
                max_map_len=MAX_KEYS,
                max_array_len=0,
                max_bin_len=0,
                max_ext_len=0,
            )
        else:
            values = json.loads(body.decode())
    except (ValueError, RecursionError) as error:
        raise _not_a_request(_beginning(body), f"one whole map in {encoding}") from error
    if not isinstance(values, dict) or len(values) > MAX_KEYS:
        raise _not_a_request(_beginning(body), f"a map of up to {MAX_KEYS} keys")
    for key, value in values.items():
        if not isinstance(key, str) or not isinstance(value, SCALARS):
            raise _not_a_request(f"a {type(value).__name__} under {key!r}", "strings, numbers, booleans and null only")
    return values


def take_id(values: dict[str, Any]) -> RequestId:
    """Remove the number or name of a request, which its reply repeats, and return it.

    Raises
    ------
    ServiceError
    """
    found = values.pop("id", None)
    if found is None or (type(found) is int and -(2**63) <= found < 2**64):
        return found
    if isinstance(found, str) and len(found) <= 64 and found.isprintable():
        return found
    raise ServiceError(
        f"{WHERE}, id",
        found=repr(found),
        expected="an integer of 64 bits, or a string of up to 64 printable characters",
        fix="Number your requests: 1, 2, 3.",
    )


def take_command(values: dict[str, Any], known: Collection[str]) -> str:
    """Remove the command from a request, and return it.

    Raises
    ------
    ServiceError
    """
    do = values.pop("do", None)
    if isinstance(do, str) and do in known:
        return do
    close = difflib.get_close_matches(do[:64], known, 1) if isinstance(do, str) else []
    raise ServiceError(
        f"{WHERE}, do",
        found="nothing" if do is None else f"the unknown command {do!r}",
        expected=f"one of {', '.join(known)}",
        fix=f"Did you mean {close[0]!r}?" if close else 'List the commands: {"do": "list"}',
    )


def ok_reply(request: RequestId, result: Any) -> dict[str, Any]:
    """Return the reply to a request that succeeded."""
    return {"id": request, "ok": True, "result": result}


def error_reply(request: RequestId, error: PuppetlineError) -> dict[str, Any]:
    """Return the reply to a request that failed."""
    return {"id": request, "ok": False, "error": {key: _quoted(text) for key, text in error.parts.items()}}


def encode(value: dict[str, Any], encoding: Encoding) -> bytes:
    """Write a request or a reply.

    Raises
    ------
    TypeError, ValueError, OverflowError, RecursionError
        It contains values without a type in JSON, or NaN.
    """
    text = json.dumps(value, allow_nan=False)
    return text.encode() if encoding == "json" else msgpack.packb(json.loads(text))


def _not_a_request(found: str, expected: str) -> ServiceError:
    return ServiceError(
        WHERE,
        found=found,
        expected=expected,
        fix='Send for example {"do": "ping"} in JSON or msgpack (docs/control.md).',
    )


def _beginning(body: bytes) -> str:
    return repr(body[:40].decode(errors="backslashreplace"))


def _quoted(text: str) -> str:
    """Shorten a string that a client may have sent, and escape what is not valid Unicode."""
    short = text if len(text) <= MAX_QUOTED_CHARACTERS else text[: MAX_QUOTED_CHARACTERS - 1] + "…"
    return short.encode("utf-8", "backslashreplace").decode()
