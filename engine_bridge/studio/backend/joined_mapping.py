"""Converts a joined service's mapping to the page's puppet, and a changed puppet to requests of docs/control.md."""

from collections.abc import Iterator
from typing import Any

from puppetline.errors import ServiceError

HANDLE_KEYS = "joint", "joints", "axes", "gain"
"""Keys of a handle that can be changed while a service runs."""


def puppet_of(mapping: dict[str, Any]) -> dict[str, Any]:
    """Return a mapping in the form of `engine_bridge.studio.messages.PuppetReply`.

    Parameters
    ----------
    mapping : dict
        Reply to `puppet` of docs/control.md.
    """
    return {
        "character": {"mesh": mapping["character"]},
        "limb": mapping["limbs"],
        "handle": [_handle(each) for each in mapping["handles"]],
        "root": mapping["root"],
        "retarget": {"mirror": mapping["mirror"], "scale": mapping["scale"]},
        "smoothing": mapping["smoothing"],
    }


def requests_of(before: dict[str, Any], after: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the commands and arguments that change one puppet into another.

    Parameters
    ----------
    before, after : dict
        Values in the form of `puppet_of`; `after` comes from the page.

    Raises
    ------
    ServiceError
        The puppets differ in more than the mapping.
    """
    for key in ("limb", "smoothing"):
        if after.get(key) != before[key]:
            raise _fixed({"limb": "other limbs", "smoothing": "another smoothing"}[key])
    handles = after.get("handle") or []
    if [_fixed_values(each) for each in handles] != [_fixed_values(each) for each in before["handle"]]:
        raise _fixed("other handles, or handles at other positions")
    for old, new in zip(before["handle"], handles, strict=True):
        if new != old:
            joints = new.get("joints") or ([] if new.get("joint") is None else [new["joint"]])
            given = {"joints": " ".join(joints) or None, "axes": new.get("axes", "xyz"), "gain": new.get("gain", 1.0)}
            yield "set_handle", {"handle": new["name"], **given}
    retarget = before["retarget"] | (after.get("retarget") or {})
    if retarget.keys() != before["retarget"].keys():
        raise _fixed("retarget keys other than mirror and scale")
    if retarget["scale"] != before["retarget"]["scale"]:
        yield "set_scale", {"scale": retarget["scale"]}
    if retarget["mirror"] != before["retarget"]["mirror"]:
        yield "mirror", {"on": retarget["mirror"]}
    root = after.get("root")
    if root != before["root"]:
        yield "set_root", {"joint": None} if root is None else {"joint": "hip_center", **root}


def _handle(mapped: dict[str, Any]) -> dict[str, Any]:
    joints = mapped["joints"]
    return {
        **{key: mapped[key] for key in ("name", "position", "axes", "gain")},
        "joint": joints[0] if len(joints) == 1 else None,
        "joints": joints if len(joints) > 1 else None,
    }


def _fixed_values(handle: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in handle.items() if key not in HANDLE_KEYS}


def _fixed(found: str) -> ServiceError:
    return ServiceError(
        "the puppet",
        found=found,
        expected="changes of the handles' joints, axes and gains, of root motion, scale and mirroring only",
        fix="Change the rest in the puppet file on the service's machine, and reload it there.",
    )
