"""Provides the web server with answers to requests, and with a state that all pages show.

`Studio` has a service of its own, and `JoinedStudio` one that runs elsewhere.
"""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from capture.smoothing import Smoothing
from engine_bridge.puppet.limb_proposal import plan_in, with_plan
from engine_bridge.puppet.puppet_values import puppet_of, values_of
from engine_bridge.studio.backend.look_reply import look_reply
from engine_bridge.studio.backend.smoothing_preview import MIN_FRAMES, preview, preview_of
from engine_bridge.studio.messages import base, characters, connection, performers, requests, takes
from engine_bridge.studio.messages.characters import PuppetReply
from engine_bridge.studio.messages.state import JobState, State, UploadReply
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.service.service_link import ServiceLink
from puppetline import toml_schema
from puppetline.errors import ServiceError


class Backend:
    """Carries out the requests that need nothing but a service.

    Parameters
    ----------
    workspace : Workspace
    service : ServiceLink
        The service.
    invite : callable
        Returns an address with a new one-time token.

    Attributes
    ----------
    joined : bool
        Whether the service was started elsewhere.
    version : int
        Increases with every change of the state.
    """

    joined = False

    def __init__(self, workspace: Workspace, service: ServiceLink, invite: Callable[[], str]) -> None:
        self.workspace, self.service = workspace, service
        self.version = 0
        self._invite = invite
        self._watchers: set[Callable[[JobState | None], None]] = set()
        service.watch(self.changed)

    @property
    def state(self) -> State:
        """The whole state."""
        raise NotImplementedError

    @property
    def models(self) -> dict[str, Path]:
        """Files with the materials of characters, by their names."""
        raise NotImplementedError

    async def begin(self, first: Path | None = None) -> None:
        """Open the characters of the last run, and a puppet file or mesh; errors are logged."""

    async def receive(self, name: str, path: Path) -> UploadReply:
        """Check a file that was received, and keep it.

        Raises
        ------
        PuppetlineError
            It cannot be read; it is deleted.
        """
        raise NotImplementedError

    async def close(self) -> None:
        """End all work, and the service if it is the studio's own."""
        await self.service.close()

    def watch(self, watcher: Callable[[JobState | None], None]) -> Callable[[], None]:
        """Call a function with None after a change of the state, and with each job that has advanced.

        Returns a function that ends this.
        """
        self._watchers.add(watcher)
        return lambda: self._watchers.discard(watcher)

    def changed(self) -> None:
        """Tell all pages that the state has changed."""
        self.version += 1
        for watcher in list(self._watchers):
            watcher(None)

    def _advanced(self, job: JobState) -> None:
        for watcher in list(self._watchers):
            watcher(job)

    async def answer(self, request: dict[str, Any]) -> Any:
        """Carry out a request, and return its result in JSON's types.

        Raises
        ------
        PuppetlineError
        """
        do = request.get("do")
        if not isinstance(do, str) or do not in requests.REQUESTS:
            raise ServiceError(
                "the request, do",
                found="nothing" if do is None else f"the unknown request {do!r:.80}",
                expected=f"one of {', '.join(requests.REQUESTS)}",
                fix="Reload the page, which may be of another version.",
            )
        checked = toml_schema.check(requests.REQUESTS[do], request, "the request", ServiceError)
        return await getattr(self, f"_do_{do}", self._refuse)(checked)

    async def _refuse(self, asked: base.Request) -> Any:
        raise NotImplementedError

    async def _do_ping(self, _: connection.Ping) -> str:
        return "pong"

    async def _do_state(self, _: connection.GetState) -> dict[str, Any]:
        return self.state.model_dump(mode="json")

    async def _do_invite(self, _: connection.Invite) -> dict[str, Any]:
        return {"address": self._invite()}

    async def _do_puppet(self, asked: characters.GetPuppet | characters.ChangePlan | characters.Edit) -> dict[str, Any]:
        raise NotImplementedError

    async def _do_change_plan(self, asked: characters.ChangePlan) -> dict[str, Any]:
        values = (await self._do_puppet(asked))["puppet"]
        changed = with_plan(puppet_of(values, values["character"]["mesh"]), asked.plan)
        return puppet_reply(asked.character, values_of(changed), saved=False)

    async def _do_look(self, asked: performers.Look) -> dict[str, Any]:
        seen = await self.service.request("look", **({"stage": asked.stage} if asked.stage else self._first_stage()))
        return look_reply(seen, self.workspace.without_folders).model_dump(mode="json")

    async def _do_smoothing_preview(self, asked: performers.SmoothingPreview) -> dict[str, Any]:
        values = asked.model_dump(include={"alpha", "gamma", "jitter_radius", "prediction"})
        smoothing = Smoothing(**values, max_deviation=math.inf if asked.max_deviation is None else asked.max_deviation)
        if asked.joint is None or asked.character is None:
            reply = await asyncio.to_thread(preview, smoothing)
        else:
            times, positions = await self._trace(asked.joint, asked.character)
            reply = await asyncio.to_thread(preview_of, smoothing, times, positions)
        return reply.model_dump(mode="json")

    async def _trace(self, joint: str, character: str) -> tuple[list[float], list[list[float]]]:
        """Return times and positions of a joint of the performer who moves a character."""
        described = self.service.described.get(character, {})
        stage = {"stage": described["stage"]} if described else {}
        traces = (await self.service.request("trace", joint=joint, **stage))["performers"]
        for each in traces:
            if each["user"] == described.get("performer") and len(each["times"]) >= MIN_FRAMES:
                return each["times"], each["positions"]
        raise ServiceError(
            "the request, joint",
            found=f"no performer who moves {character!r} with the joint {joint!r}",
            expected="a performer in view for half a second",
            fix="Try again in a second.",
        )

    async def _begin_take(self, asked: takes.RecordStart) -> dict[str, Any]:
        """Record a take of a character's stage or the first one, and return the service's reply."""
        wanted = asked.model_dump(include={"name", "count_in"}, exclude_defaults=True)
        described = self.service.described.get(asked.character or "")
        stage = self._first_stage() if described is None else {"stage": described["stage"]}
        begun: dict[str, Any] = await self.service.request("record_start", **wanted, **stage)
        return begun

    def _first_stage(self) -> dict[str, str]:
        """Return the argument of a request that names the first stage; empty while there is no stage."""
        stages = [each["name"] for each in self.service.status.get("stages", [])]
        return {"stage": stages[0]} if stages else {}

    async def _pass_on(self, asked: base.Request) -> Any:
        """Send a request to the service, and return its result."""
        arguments = asked.model_dump(exclude={"id", "do"}, exclude_unset=True)
        result = await self.service.request(getattr(asked, "do", ""), **arguments)
        await self.service.refresh()
        return result

    _do_calibrate = _do_choose_user = _do_pause = _do_seek = _do_stop = _pass_on


def puppet_reply(character: str, values: dict[str, Any], saved: bool) -> dict[str, Any]:
    """Return a `PuppetReply` in JSON's types, from the values of a character's puppet."""
    plan = plan_in(puppet_of(values, values["character"]["mesh"]))
    return PuppetReply(character=character, puppet=values, saved=saved, plan=plan).model_dump(mode="json")
