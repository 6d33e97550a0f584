"""A studio for a service that runs elsewhere: shows and edits its characters, calibrates and records.

The files of the service are on its machine. Therefore nothing is opened, closed, exported or downloaded here.
"""

import asyncio
import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Never

from engine_bridge.puppet.puppet_values import puppet_of, values_of
from engine_bridge.studio.backend.backend import Backend, puppet_reply
from engine_bridge.studio.backend.page_state import state_of, version_of
from engine_bridge.studio.messages import base, characters, takes
from engine_bridge.studio.messages.state import CharacterState, SourceState, State, TakeState
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.screen.models import Models
from engine_bridge.studio.service.chosen_source import ChosenSource
from engine_bridge.studio.service.joined_service import JoinedService
from puppetline.errors import PuppetlineError, ServiceError

PUPPET_SECONDS = 1.0
"""Interval at which the service is asked for puppets and takes, which other clients may change, in seconds."""


class JoinedStudio(Backend):
    """The backend of the page for a service that runs elsewhere.

    Parameters
    ----------
    workspace : Workspace
        It stays empty.
    service : JoinedService
    invite : callable
        Returns an address with a new one-time token.
    puppets : dict of str to Path
        Puppet files of the service's characters, if they are on this machine.
    """

    joined = True
    service: JoinedService

    def __init__(
        self, workspace: Workspace, service: JoinedService, invite: Callable[[], str], puppets: dict[str, Path]
    ) -> None:
        super().__init__(workspace, service, invite)
        self._models = Models(puppets, workspace.folder)
        self._puppets: dict[str, dict[str, Any]] = {}
        self._takes: list[TakeState] = []
        self._poller = asyncio.create_task(self._poll())

    @property
    def state(self) -> State:
        """The whole state."""
        stages = self.service.status.get("stages", [])
        source = ", ".join(each["source"] for each in stages)
        playing = ChosenSource(source, SourceState(uri=source, kind="live", name=source, text=source))
        characters = [
            _character(each, self._puppets[name])
            for name, each in self.service.described.items()
            if name in self._puppets
        ]
        recording = next((each["recording"] for each in stages if each["recording"] is not None), None)
        return state_of(characters, playing, self.service, self._takes, self.workspace, [], recording)

    @property
    def models(self) -> dict[str, Path]:
        """Files with the materials of characters, by their names."""
        return self._models.made

    async def receive(self, name: str, path: Path) -> Never:
        """Refuse a file."""
        self.workspace.discard(path)
        raise _elsewhere(name)

    async def close(self) -> None:
        """End the connection."""
        self._poller.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._poller
        await self._models.close()
        await super().close()

    async def _refuse(self, asked: base.Request) -> Never:
        raise _elsewhere(f"the request {getattr(asked, 'do', '')}")

    async def _do_puppet(self, asked: characters.GetPuppet | characters.ChangePlan | characters.Edit) -> dict[str, Any]:
        return self._took(await self.service.request("puppet", character=asked.character))

    async def _do_edit(self, asked: characters.Edit) -> dict[str, Any]:
        known = (await self._do_puppet(asked))["puppet"]
        edited = values_of(puppet_of(asked.puppet, known["character"]["mesh"]))  # omitted keys have their defaults
        changes = json.dumps({name: table for name, table in edited.items() if table != known[name]})
        return self._took(await self.service.request("set_puppet", character=asked.character, puppet=changes))

    async def _do_save_puppet(self, asked: characters.SavePuppet) -> dict[str, Any]:
        self._took(await self.service.request("save_puppet", character=asked.character))
        return {"character": asked.character, "name": "", "file": ""}

    async def _do_record_start(self, asked: takes.RecordStart) -> dict[str, Any]:
        begun = await self._begin_take(asked)
        await self.service.refresh()
        return {"take": begun["take"]}

    async def _do_record_stop(self, _: takes.RecordStop) -> dict[str, Any]:
        stages = [each["name"] for each in self.service.status.get("stages", []) if each["recording"] is not None]
        ended = await self.service.request("record_stop", **({"stage": stages[0]} if stages else {}))
        await self.service.refresh()
        await self._list_takes()
        take = next((each for each in self._takes if each.name == ended["take"]), None)
        return {} if take is None else take.model_dump(mode="json")

    def _took(self, known: dict[str, Any]) -> dict[str, Any]:
        """Keep a puppet of the service (`puppet` of docs/control.md), and return it for the page."""
        reply = puppet_reply(known["character"], known["puppet"], known["saved"])
        if self._puppets.get(known["character"]) != reply:
            self._puppets[known["character"]] = reply
            self.changed()
        return reply

    async def _list_takes(self) -> None:
        listed = (await self.service.request("list"))["takes"]
        takes = [TakeState(seconds=None, frames=0, **each) for each in listed]
        if takes != self._takes:
            self._takes = takes
            self.changed()

    async def _poll(self) -> None:
        while True:
            with contextlib.suppress(PuppetlineError):
                for name in list(self.service.described):
                    self._took(await self.service.request("puppet", character=name))
                if self.service.status:
                    await self._list_takes()
            await asyncio.sleep(PUPPET_SECONDS if self._puppets else PUPPET_SECONDS / 10)


def _character(described: dict[str, Any], reply: dict[str, Any]) -> CharacterState:
    return CharacterState(
        name=described["name"],
        title=described["name"],
        limbs=[each["name"] for each in reply["puppet"]["limb"]],
        handles=[each["name"] for each in reply["puppet"]["handle"]],
        version=version_of(reply["puppet"]),
        saved=reply["saved"],
        **{key: described[key] for key in ("stage", "vertices", "triangles", "performer", "state", "mirror")},
    )


def _elsewhere(where: str) -> ServiceError:
    return ServiceError(
        where,
        found="a service that was started elsewhere",
        expected="a service of the studio",
        fix="Change the files on the service's machine, or start puppetline studio without --service.",
    )
