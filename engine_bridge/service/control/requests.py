"""What clients may ask of the service, and how requests and replies are written: docs/control.md.

A request is one flat map, in JSON or msgpack: ``{"do": "calibrate", "id": 7, "character": "dog"}``.
"""

import difflib
import json
import re
from collections.abc import Collection
from typing import Annotated, Any, Literal

import msgpack
from pydantic import AfterValidator, BeforeValidator, Field, StrictBool

from capture.skeleton import JOINTS
from engine_bridge.puppet.puppet import AxisSet, JointName, Number, Scale
from puppetline.errors import PuppetlineError, ServiceError
from puppetline.toml_schema import Table, mistake

Encoding = Literal["json", "msgpack"]
RequestId = int | str | None

WHERE = "the request"
LARGEST = 65_536
"""Bytes of a request."""

MOST_KEYS = 16
LONGEST_TEXT = 500
"""Characters of what an error quotes."""

NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
SCALARS = (str, int, float, bool, type(None))
MSGPACK_MAPS = frozenset([*range(0x80, 0x90), 0xDE, 0xDF])


def _plain_name(name: str) -> str:
    """Let no path through: what a name stands for is looked up, or put into the folder of takes."""
    if not NAME.fullmatch(name):
        raise mistake(
            found=repr(name), expected="a name of 1 to 64 letters (a to z), digits, _ and -", fix="Give it such a name."
        )
    return name


def _joint_names(value: Any) -> Any:
    """Split what stands for a list, which a request does not have."""
    if value is None:
        return ()
    if not isinstance(value, str):
        raise mistake(
            found=repr(value),
            expected="names of joints with spaces between them, or null",
            fix="Write 'hand_left'.",
        )
    return tuple(value.split())


Name = Annotated[str, Field(strict=True), AfterValidator(_plain_name)]
Joints = Annotated[tuple[JointName, ...], Field(max_length=len(JOINTS)), BeforeValidator(_joint_names)]
User = Annotated[int, Field(strict=True, ge=0, le=2**31 - 1)]


class Nothing(Table):
    """No arguments."""


class ChooseUser(Table):
    """Give a character a performer; none to let the service choose."""

    character: Name
    user: User | None


class Mirror(Table):
    """Let the performer's left move the character's right, or not."""

    character: Name
    on: Annotated[bool, Field(strict=True)]


class OneCharacter(Table):
    """Something about a character."""

    character: Name


class SetHandle(Table):
    """Have other joints move a handle, along other axes, or farther; what is left out stays."""

    character: Name
    handle: Annotated[str, Field(strict=True, min_length=1)]
    joints: Joints = ()
    axes: AxisSet = "xyz"
    gain: Number = 1.0


class SetRoot(Table):
    """Have another joint carry the character, or none; what is left out stays."""

    character: Name
    joint: JointName | None
    axes: AxisSet = "xz"
    turns: StrictBool = True
    feet: Literal["lock", "free"] = "lock"


class SetScale(Table):
    """Set the character's metres for one of the performer's."""

    character: Name
    scale: Scale


class RecordStart(Table):
    """Record a stage, the only one where none is named."""

    name: Name | None = None
    stage: Name | None = None


class RecordStop(Table):
    """End the recording of a stage."""

    stage: Name | None = None


ARGUMENTS: dict[str, type[Table]] = {
    "ping": Nothing,
    "list": Nothing,
    "describe": Nothing,
    "calibrate": OneCharacter,
    "choose_user": ChooseUser,
    "mirror": Mirror,
    "record_start": RecordStart,
    "record_stop": RecordStop,
    "puppet": OneCharacter,
    "set_handle": SetHandle,
    "set_root": SetRoot,
    "set_scale": SetScale,
    "save_puppet": OneCharacter,
    "revert_puppet": OneCharacter,
    "reload": Nothing,
}
"""All that can be asked for, and what goes with it."""


def encoding_of(body: bytes) -> Encoding:
    """Tell by the first byte how a request is written, and its reply will be."""
    return "msgpack" if body[:1] and body[0] in MSGPACK_MAPS else "json"


def decode(body: bytes) -> dict[str, Any]:
    """Read a request: texts as keys; texts, numbers, booleans and null as values.

    Raises
    ------
    ServiceError
    """
    if len(body) > LARGEST:
        raise _not_a_request(f"{len(body)} bytes", f"no more than {LARGEST}")
    encoding = encoding_of(body)
    try:
        if encoding == "msgpack":
            values = msgpack.unpackb(
                body,
                raw=False,
                strict_map_key=True,
                max_map_len=MOST_KEYS,
                max_array_len=0,
                max_bin_len=0,
                max_ext_len=0,
            )
        else:
            values = json.loads(body.decode())
    except (ValueError, RecursionError) as error:
        raise _not_a_request(_beginning(body), f"one whole map in {encoding}") from error
    if not isinstance(values, dict) or len(values) > MOST_KEYS:
        raise _not_a_request(_beginning(body), f"a map of up to {MOST_KEYS} keys")
    for key, value in values.items():
        if not isinstance(key, str) or not isinstance(value, SCALARS):
            raise _not_a_request(f"a {type(value).__name__} under {key!r}", "texts, numbers, booleans and null only")
    return values


def take_id(values: dict[str, Any]) -> RequestId:
    """Remove what the reply will be known by from a request, and return it.

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
        expected="a whole number of 64 bits, or a text of up to 64 printable characters",
        fix="Count your requests: 1, 2, 3.",
    )


def take_command(values: dict[str, Any], known: Collection[str]) -> str:
    """Remove what is to be done from a request, and return it: one of those that are known.

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
        fix=f"Did you mean {close[0]!r}?" if close else 'Ask for one of them: {"do": "list"}',
    )


def ok_reply(request: RequestId, result: Any) -> dict[str, Any]:
    """Return the reply that something was done."""
    return {"id": request, "ok": True, "result": result}


def error_reply(request: RequestId, error: PuppetlineError) -> dict[str, Any]:
    """Return the reply that something could not be done, and why."""
    told = {"where": error.where, "found": error.found, "expected": error.expected, "fix": error.fix}
    return {"id": request, "ok": False, "error": {key: _quoted(text) for key, text in told.items()}}


def encode(value: dict[str, Any], encoding: Encoding) -> bytes:
    """Write a request or a reply.

    Raises
    ------
    TypeError, ValueError, OverflowError, RecursionError
        It holds what JSON has no type for, NaN included.
    """
    text = json.dumps(value, allow_nan=False)
    return text.encode() if encoding == "json" else msgpack.packb(json.loads(text))


def _not_a_request(found: str, expected: str) -> ServiceError:
    return ServiceError(
        WHERE, found=found, expected=expected, fix='Send {"do": "ping"}, say, in JSON or msgpack (docs/control.md).'
    )


def _beginning(body: bytes) -> str:
    return repr(body[:40].decode(errors="backslashreplace"))


def _quoted(text: str) -> str:
    """Shorten a text, some of which a client may have sent, and write out what is no character."""
    short = text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 1] + "…"
    return short.encode("utf-8", "backslashreplace").decode()
