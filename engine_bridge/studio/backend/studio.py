"""The studio: carries out requests, and keeps the state that all pages show."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

from capture.sources.demo import performances
from engine_bridge.character.examples import MOTIONS
from engine_bridge.inspection.finding import Finding
from engine_bridge.performance.settings import PerformerFormat
from engine_bridge.studio.backend.backend import Backend, puppet_reply
from engine_bridge.studio.backend.film_editing import FilmEditing
from engine_bridge.studio.backend.film_sharing import FilmSharing, Serve
from engine_bridge.studio.backend.page_state import character_state, state_of
from engine_bridge.studio.backend.request_checks import check_known, check_one, in_use
from engine_bridge.studio.backend.take_drawing import TakeDrawing
from engine_bridge.studio.long_work.installation import MODULES, TITLES, is_installed
from engine_bridge.studio.long_work.jobs import Jobs
from engine_bridge.studio.long_work.worker import Progress, Worker
from engine_bridge.studio.messages import characters, film, performers, takes
from engine_bridge.studio.messages.state import SourceState, State, UploadReply
from engine_bridge.studio.project.open_characters import Characters, OpenCharacter
from engine_bridge.studio.project.take_list import TakeList
from engine_bridge.studio.project.workspace import Upload, Workspace, shown
from engine_bridge.studio.service import chosen_source
from engine_bridge.studio.service.chosen_source import ChosenSource
from engine_bridge.studio.service.own_service import OwnService
from puppetline.errors import PuppetlineError, ServiceError

FIRST_EXAMPLE = "walk"
"""Example motion that drives the first character, if no source has been chosen."""

log = logging.getLogger(__name__)


class Studio(Backend):
    """The backend of the page for a service that the studio starts.

    Parameters
    ----------
    workspace : Workspace
    service : OwnService
        The service.
    invite : callable
        Returns an address with a new one-time token.
    serve : callable
        Serves films to phones, see `Serve`.
    sound : str, optional
        What is heard from the start, instead of the system's microphone when a page switches it on.
    """

    service: OwnService

    def __init__(
        self,
        workspace: Workspace,
        service: OwnService,
        invite: Callable[[], str],
        serve: Serve,
        sound: str | None = None,
    ) -> None:
        super().__init__(workspace, service, invite)
        self._workers = Worker(), Worker(), Worker()  # none of these waits for what the others do
        self._worker, self._exporter, self._planner = self._workers
        self._jobs = Jobs(self.changed, self._advanced, workspace.told)
        self.characters = Characters(workspace, self._worker)
        self._playing = chosen_source.NOTHING
        self._sound, self._hears = sound or "default", sound is not None
        self._take: tuple[str, str] | None = None  # stage and take
        self._recorded = ""  # the character that the take is for
        self._takes = TakeList(workspace)
        self._film = FilmEditing(workspace, service, self._takes)
        self._pictures = TakeDrawing(self._takes, self._film, self.characters, self._exporter, self.changed)
        self._sharing = FilmSharing(workspace, self._exporter, serve)
        self._changing, self._listing = asyncio.Lock(), asyncio.Lock()

    def _service_changed(self) -> None:
        if not self.service.state.running:
            self._take = None  # the take ended with the service
        self.changed()

    @property
    def state(self) -> State:
        """The whole state."""
        state = state_of(
            [character_state(each, self.service.described.get(each.name, {})) for each in self.characters.all],
            self._playing,
            self.service,
            self._takes.states,
            self.workspace,
            self._jobs.states,
            None if self._take is None else self._take[1],
        )
        installed = [extra for extra in MODULES if is_installed(extra)]
        return state.model_copy(update={"film": self._film.state, "installed": installed, "microphone": self._hears})

    @property
    def models(self) -> dict[str, Path]:
        """Files with the materials of characters, by their names."""
        return {each.name: each.model.path for each in self.characters.all if each.model is not None}

    async def receive(self, name: str, path: Path) -> UploadReply:
        """Check a received file, in the worker, and keep it."""
        try:
            facts = await self._worker.run("inspect", path)
        except BaseException:
            self.workspace.discard(path)
            raise
        if facts["kind"] in ("sound", "picture"):
            file = self.workspace.keep_media(path)
            return UploadReply(upload="", kind=facts["kind"], name=shown(name), facts={}, file=file)
        upload = self.workspace.keep(name, path, facts["kind"], facts)
        self.changed()
        return UploadReply(upload=upload.id, kind=upload.kind, name=upload.name, facts=facts)

    async def begin(self, first: Path | None = None) -> None:
        """Open the characters of the last run, and a puppet file or mesh; errors are logged."""
        session = self.workspace.read_session()
        async with self._changing:
            for each in session.get("characters", []):
                with _logged_errors("a character of the last run cannot be opened"):
                    again = partial(self.characters.reopen, each["name"], each["title"], Path(each["saved_file"]))
                    await self._jobs.run(f"Opening {each['title']}", partial(self._reopen, again))
            with _logged_errors("the source of the last run cannot be opened"):
                self._playing = await self._remembered(session.get("source", {}))
            with _logged_errors("the service cannot start"):
                await self._replace(self._playing)
        if first is not None:
            with _logged_errors(f"{first.name} cannot be opened"):
                await self._open(first.name, partial(self._open_first, first))
        for each in self.characters.all:
            self._introduce(each)
        self._pictures.begin()
        await asyncio.gather(self._worker.get_ready(), self.service.get_ready())

    async def _reopen(
        self, again: Callable[[Progress], Awaitable[OpenCharacter]], progress: Progress
    ) -> dict[str, Any]:
        return {"character": (await again(progress)).name}

    async def _remembered(self, source: dict[str, Any]) -> ChosenSource:
        """Return the source of the last run; uploads are not kept."""
        state = SourceState.model_validate(source)
        given: dict[str, str | None] = {"uri": None, "example": None, "take": None}
        key = {"live": "uri", "example": "example", "take": "take"}.get(state.kind)
        if key is None:
            return chosen_source.NOTHING
        given[key] = state.name
        rest = {"loop": state.loop, "start": state.start, "stop": state.stop}
        return await self._chosen(performers.Source.model_validate({"id": 0, "do": "source", **given, **rest}))

    async def _open_first(self, first: Path, progress: Progress) -> OpenCharacter:
        if first.suffix.lower() == ".toml":
            return await self.characters.open_file(first, progress)
        mesh = Upload("", first.name, first.absolute(), "character", {})
        options = {"up": None, "front": None, "scale": None, "limbs": True, "mirror": False}
        return await self.characters.open_mesh(mesh, options, progress)

    async def close(self) -> None:
        """End the service and all work."""
        await self._pictures.close()
        await self._sharing.close()
        for worker in self._workers:
            await worker.close()
        await self.service.close()

    async def _do_open_character(self, asked: characters.OpenCharacter) -> dict[str, Any]:
        upload = self.workspace.upload(asked.upload, "character")
        options = {key: getattr(asked, key) for key in ("up", "front", "scale", "limbs", "mirror")}
        return await self._open(upload.name, partial(self.characters.open_mesh, upload, options))

    async def _do_open_puppet(self, asked: characters.OpenPuppet) -> dict[str, Any]:
        puppet = self.workspace.upload(asked.upload, "puppet")
        mesh = self.workspace.mesh_of(puppet) if asked.mesh is None else self.workspace.upload(asked.mesh, "character")
        return await self._open(puppet.name, partial(self.characters.open_puppet, puppet, mesh))

    async def _do_open_example(self, asked: characters.OpenExample) -> dict[str, Any]:
        check_known(asked.name, list(MOTIONS), "name")
        return await self._open(asked.name, partial(self.characters.open_example, asked.name), MOTIONS[asked.name])

    async def _do_close_character(self, asked: characters.CloseCharacter) -> dict[str, Any]:
        async with self._change():
            self.characters.close(asked.character)
            with _logged_errors("the film keeps a character that was closed"):
                self._film.file.remove(asked.character)
            await self._apply()
        return {}

    async def _do_source(self, asked: performers.Source) -> dict[str, Any]:
        playing = await self._chosen(asked)
        others = contextlib.nullcontext() if asked.uri is None else self._listing  # it listens to the same ports
        async with others, self._change():
            await self._replace(playing)
        return playing.state.model_dump(mode="json")

    async def _do_sources(self, _: performers.GetSources) -> dict[str, Any]:
        from engine_bridge.studio.service.available_sources import device, ports

        async with self._listing:  # two could not listen to the same port
            examined, listened = self._worker.run("devices"), asyncio.to_thread(ports, self._playing.uri)
            found, arriving = await asyncio.gather(examined, listened)
        devices = [device(Finding(**each)) for each in found]
        listed = performers.Sources(
            characters=list(MOTIONS), examples=list(performances()), devices=devices, ports=arriving
        )
        return listed.model_dump(mode="json")

    async def _do_puppet(self, asked: characters.GetPuppet | characters.ChangePlan | characters.Edit) -> dict[str, Any]:
        character = self.characters[asked.character]
        return puppet_reply(character.name, character.puppet, character.puppet == character.saved)

    async def _do_edit(self, asked: characters.Edit) -> dict[str, Any]:
        async with self._change():
            character = await self.characters.edit(asked.character, asked.puppet)
            await self._apply()
        return puppet_reply(character.name, character.puppet, character.puppet == character.saved)

    async def _do_save_puppet(self, asked: characters.SavePuppet) -> dict[str, Any]:
        async with self._changing:
            character = await self.characters.save(asked.character)
        file = self.workspace.offer_puppet(character.saved_file)
        self.changed()
        return {"character": character.name, "name": file.name, "file": file.id}

    async def _do_record_start(self, asked: takes.RecordStart) -> dict[str, Any]:
        async with self._change():  # which would end the take
            character = asked.character or next((each.name for each in self.characters.all), "")
            await self._film.play(self._film.end_of(character), but=character)
            await self._film.claim(character)
            begun = await self._begin_take(asked.model_copy(update={"name": asked.name or self._takes.new_name()}))
            self._take, self._recorded = (begun["stage"], begun["take"]), character
        self.changed()
        return {"take": begun["take"]}

    async def _do_record_stop(self, _: takes.RecordStop) -> dict[str, Any]:
        stage = {} if self._take is None else {"stage": self._take[0]}
        self._take = None
        ended = await self.service.request("record_stop", **stage)
        with contextlib.suppress(PuppetlineError):
            await self.service.request("stop")
        if not ended["bytes"]:  # it has ended during the count-in
            self.changed()
            return {}
        take = self._takes.state(ended["take"])
        if take.seconds:
            with _logged_errors("the take is not added to the film"):
                self._film.add(take, self._recorded)
        self._pictures.begin()
        self.changed()
        return take.model_dump(mode="json")

    async def _do_microphone(self, asked: takes.Microphone) -> dict[str, Any]:
        async with self._change():
            await self._replace(self._playing, asked.on)
        return {}

    async def _do_delete_take(self, asked: takes.DeleteTake) -> dict[str, Any]:
        self._takes.path(asked.take)  # refuses an unknown one
        timeline = self.state.timeline
        playing = () if timeline is None else (each.take for each in timeline.takes)
        if asked.take in playing or (self._playing.state.kind == "take" and self._playing.state.name == asked.take):
            raise in_use(asked.take)
        with _logged_errors("the film keeps a take that was deleted"):
            self._film.forget(asked.take)
        self._takes.delete(asked.take)
        self.changed()
        return {}

    async def _do_edit_film(self, asked: film.EditFilm) -> dict[str, Any]:
        self._film.edit(asked.takes, asked.scene)
        self.changed()
        return self._film.state.model_dump(mode="json")

    async def _do_play_film(self, asked: film.PlayFilm) -> dict[str, Any]:
        self._refuse_while_recording()
        failed = await self._film.play(asked.at)
        with contextlib.suppress(PuppetlineError):  # nothing plays
            await self.service.request("seek", seconds=asked.at)
            await self.service.request("pause", on=False)
        await self.service.refresh()
        if failed is not None:
            raise failed
        return {}

    async def _do_plan_film(self, _: film.PlanFilm) -> dict[str, Any]:
        plan: dict[str, Any] = await self._planner.run("plan_film", self._film.file.path)
        return plan

    async def _do_make_film(self, _: film.MakeFilm) -> dict[str, Any]:
        self._refuse_while_recording()

        async def work(progress: Progress) -> dict[str, Any]:
            output = self.workspace.new_export("film", ".mp4")
            self._planner, self._exporter = self._exporter, self._planner  # the planner has solved the film's takes
            made = await self._exporter.run("make_film", self._film.file.path, output, progress=progress)
            file = self.workspace.offer(output, output.name, "export")
            return film.FilmReply(file=file.id, name=file.name, **made).model_dump(mode="json")

        return await self._jobs.run("Making the film", work)

    async def _do_share_film(self, asked: film.ShareFilm) -> dict[str, Any]:
        shared = await self._sharing.share(self.workspace.export(asked.file).path)
        return shared.model_dump(mode="json")

    async def _do_install(self, asked: film.Install) -> dict[str, Any]:
        self._refuse_while_recording()

        async def work(progress: Progress) -> dict[str, Any]:
            async with self._change():
                await self.service.play([])  # packages change, which a running program must not have loaded
                try:
                    await self._exporter.run("install", asked.extra, progress=progress)
                finally:
                    for worker in self._workers:
                        await worker.close()
                    await self._apply()
            return {}

        return await self._jobs.run(TITLES[asked.extra], work)

    async def _do_delete_upload(self, asked: characters.DeleteUpload) -> dict[str, Any]:
        upload = self.workspace.upload(asked.upload)
        if self._playing.uri.partition(":")[2].startswith(str(upload.path.parent)):
            raise in_use(upload.name)
        self.workspace.delete_upload(asked.upload)
        self.changed()
        return {}

    async def _do_export(self, asked: takes.Export) -> dict[str, Any]:
        character = self.characters[asked.character]
        check_one(asked, ("take", "upload", "example"))
        title = f"Export of {asked.take or asked.example or self.workspace.upload(str(asked.upload)).name}"

        async def work(progress: Progress) -> dict[str, Any]:
            log = await self._recording(asked.take, asked.upload, asked.example)
            part = asked.start or 0.0, asked.stop
            if asked.form in get_args(PerformerFormat):
                output = self.workspace.new_export(log.stem, f".{asked.form}")
                made = await self._exporter.run("export_performer", log, output, *part, progress=progress)
            else:
                output = self.workspace.new_export(f"{character.name}_{log.stem}", ".glb")
                arguments = log, character.folder, output, asked.form, *part
                made = await self._exporter.run("export", *arguments, progress=progress)
            file = self.workspace.offer(output, output.name, "export")
            return takes.ExportReply(file=file.id, name=file.name, **made).model_dump(mode="json")

        return await self._jobs.run(f"{title} for {character.name}", work)

    async def _do_cancel(self, asked: takes.Cancel) -> dict[str, Any]:
        self._jobs.cancel(asked.job)
        return {}

    def _introduce(self, character: OpenCharacter) -> None:
        """Let a character stand in the film beside the others."""
        with _logged_errors("a character is not added to the film"):
            self._film.file.introduce(character.name, {each.name: each.width for each in self.characters.all})

    @contextlib.asynccontextmanager
    async def _change(self) -> AsyncIterator[None]:
        """Change what the service runs, or begin a take, one after another."""
        async with self._changing:
            self._refuse_while_recording()
            yield

    def _refuse_while_recording(self) -> None:
        """Refuse a change during a take, which has the same characters and source from beginning to end."""
        if self._take is not None:
            raise ServiceError(
                "the stage",
                found=f"the take {self._take[1]!r}, which is being recorded",
                expected="a stage that is not recording",
                fix="Stop the recording first.",
            )

    async def _recording(self, take: str | None, upload: str | None, example: str | None) -> Path:
        """Return the file of a recording; an example is written first."""
        if take is not None:
            return self._takes.path(take)
        if upload is not None:
            return self.workspace.upload(upload, "log").path
        check_known(str(example), list(performances()), "example")
        path = self.workspace.folder / "examples" / f"{example}.log"
        if not path.exists():
            await self._exporter.run("write_example", example, path)
        return path

    async def _open(self, title: str, make: Callable[[Progress], Any], motion: str = FIRST_EXAMPLE) -> dict[str, Any]:
        """Open a character as a job, and add it to the service."""
        self._refuse_while_recording()

        async def work(progress: Progress) -> dict[str, Any]:
            async with self._change():
                character: OpenCharacter = await make(progress)
                playing = chosen_source.example(motion) if self._playing is chosen_source.NOTHING else self._playing
                progress("Starting", 0.0)
                try:
                    await self._replace(playing)
                except BaseException:
                    self.characters.close(character.name)
                    with contextlib.suppress(PuppetlineError):
                        await self._apply()
                    raise
                self._introduce(character)
                self.changed()
            return {"character": character.name}

        return await self._jobs.run(f"Opening {title}", work)

    async def _chosen(self, asked: performers.Source) -> ChosenSource:
        """Return the source that a request chooses."""
        check_one(asked, ("uri", "upload", "example", "take"))
        if asked.uri is not None:
            return chosen_source.live(asked.uri)
        if asked.example is not None:
            check_known(asked.example, list(performances()), "example")
            return chosen_source.example(asked.example, asked.loop)
        kind: Literal["upload", "take"] = "take" if asked.upload is None else "upload"
        if asked.upload is not None and self.workspace.upload(asked.upload).kind == "video":
            video = self.workspace.upload(asked.upload)
            if asked.start is not None or asked.stop is not None:
                raise ServiceError(
                    video.name,
                    found="start or stop with a video",
                    expected="a video as a whole",
                    fix="Trim the video, or omit start and stop.",
                )
            return chosen_source.video(video.path, video.name, asked.loop)
        name = self.workspace.upload(asked.upload, "log").name if asked.upload is not None else str(asked.take)
        path = await self._recording(asked.take, asked.upload, None)
        if asked.start is not None or asked.stop is not None:
            whole, path = path, self.workspace.new_export(path.stem, ".log")
            await self._worker.run("trim", whole, path, asked.start, asked.stop)
        return chosen_source.recording(path, name, kind, asked.loop, asked.start, asked.stop)

    async def _replace(self, playing: ChosenSource, hears: bool | None = None) -> None:
        """Change the source, or whether there is sound; what was before continues if it cannot be opened."""
        before, after = (self._playing, self._hears), (playing, self._hears if hears is None else hears)
        self._playing, self._hears = after
        try:
            await self._apply()
        except BaseException:
            self._playing, self._hears = before
            if before != after:
                with contextlib.suppress(PuppetlineError):
                    await self._apply()
            raise

    async def _apply(self) -> None:
        """Run the service with the open characters and the chosen source."""
        try:
            heard = self._sound if self._hears else None
            stages = chosen_source.stages(self.characters.all, self._playing, self.workspace.folder, heard)
            await self.service.play(stages)
        finally:
            self._store()
            self.changed()

    def _store(self) -> None:
        values = {
            "source": self._playing.state.model_dump(mode="json"),
            "characters": [
                {"name": each.name, "title": each.title, "saved_file": str(each.saved_file)}
                for each in self.characters.all
            ],
        }
        with contextlib.suppress(PuppetlineError):
            self.workspace.write_session(values)


@contextlib.contextmanager
def _logged_errors(what: str) -> Iterator[None]:
    """Log errors of what is opened at the start; the studio continues."""
    try:
        yield
    except (PuppetlineError, ValueError, KeyError, TypeError) as error:
        log.warning("%s: %s", what, error)
