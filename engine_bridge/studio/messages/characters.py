"""Requests that open, close, edit and save characters."""

from typing import Any, Literal

from engine_bridge.puppet.body_plans import BodyPlan
from engine_bridge.studio.messages.base import Id, Name, Request
from puppetline.toml_schema import Table


class OpenCharacter(Request):
    """Propose a puppet for an uploaded mesh and open it, a job.

    `up`, `front` and `scale` are as in the puppet file; None detects them. `limbs` false proposes handles only. If no
    source has been chosen, an example performer starts, so that the character moves.

    A job. Result: ``{"character": name}``.
    """

    do: Literal["open_character"]
    upload: Id
    up: str | None = None
    front: str | None = None
    scale: float | None = None
    limbs: bool = True
    mirror: bool = False


class OpenPuppet(Request):
    """Open an uploaded puppet file with an uploaded mesh: by default, the one whose name is in the puppet file.

    A job. Result: ``{"character": name}``.
    """

    do: Literal["open_puppet"]
    upload: Id
    mesh: Id | None = None


class OpenExample(Request):
    """Open an example character, of `Sources.characters`. A job. Result: ``{"character": name}``."""

    do: Literal["open_example"]
    name: Name


class CloseCharacter(Request):
    """Close a character; unsaved edits are lost. Result: ``{}``."""

    do: Literal["close_character"]
    character: Name


class GetPuppet(Request):
    """Request a character's puppet. Result: `PuppetReply`."""

    do: Literal["puppet"]
    character: Name


class PuppetReply(Table):
    """A whole puppet.

    Attributes
    ----------
    character : str
    puppet : dict
        All tables of `engine_bridge.puppet.puppet.Puppet` with all keys: ``character`` (``mesh`` is a file name),
        ``limb`` (``name``, ``nodes``, ``points``, ``joints``, ``follow``, ``gain``, ``parent``), ``handle`` (``name``,
        ``position``, ``joint``, ``joints``, ``axes``, ``gain``), ``root`` or None, ``retarget`` (``mirror``, ``scale``,
        ``arm_space``, ``hands_meet``), ``smoothing`` (``max_deviation`` None for infinity) and ``solver``.
    saved : bool
        As in `CharacterState`.
    plan : BodyPlan or None
        The body plan that the limbs follow; None if they follow none.
    """

    character: str
    puppet: dict[str, Any]
    saved: bool
    plan: BodyPlan | None = None


class Edit(Request):
    """Replace a puppet with another one of the same mesh, while the service runs. Result: `PuppetReply`.

    `puppet` is as in `PuppetReply`; omitted keys have their defaults, and ``character.mesh`` is ignored. A new mapping
    is applied immediately. New points of limbs or new handles take a second to compute for a large mesh; until then,
    the character moves as before, and the reply comes afterwards.
    """

    do: Literal["edit"]
    character: Name
    puppet: dict[str, Any]


class ChangePlan(Request):
    """Let the limbs follow the performer as another body plan says (docs/animals.md).

    Names, points and handles are kept. Result: `PuppetReply`; its puppet is not applied until it is sent as `Edit`.
    """

    do: Literal["change_plan"]
    character: Name
    plan: BodyPlan


class SavePuppet(Request):
    """Save the puppet into its file, whose comments and order are kept.

    Result: ``{"character", "name", "file"}``, with the id to download it.

    The file is the one that was opened from the command line, otherwise a copy in the studio's folder.
    """

    do: Literal["save_puppet"]
    character: Name


class DeleteUpload(Request):
    """Delete an upload that nothing uses. Result: ``{}``."""

    do: Literal["delete_upload"]
    upload: Id
