"""The commands of the control socket (docs/control.md)."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from math import isfinite
from typing import Any

from capture.skeleton import JOINTS
from engine_bridge.puppet.puppet import Puppet, RootTable, has_same_model, with_handle
from engine_bridge.puppet.puppet_values import merged, puppet_of, values_of
from engine_bridge.service.control import requests
from engine_bridge.service.control.dispatcher import Command, Deferred
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.service import Service
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.takes.timeline import Timeline
from puppetline import clock
from puppetline.errors import ServiceError, unknown_name
from puppetline.toml_schema import Table


def commands(service: Service) -> Mapping[str, Command]:
    """Bind all commands to a service."""
    done = _Commands(service)
    return {name: (arguments, getattr(done, name)) for name, arguments in ARGUMENTS.items()}


class _Commands:
    """One method per command, of the same name."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def ping(self, _: requests.Nothing) -> str:
        return "pong"

    def list(self, _: requests.Nothing) -> dict[str, Any]:
        return {
            "characters": self._service.names,
            "stages": [runner.stage.name for runner in self._service.runners],
            "takes": self._service.takes.all(),
            "commands": [*ARGUMENTS],
        }

    def describe(self, _: requests.Nothing) -> dict[str, Any]:
        service = self._service
        return {
            "protocol": 1,
            "stream": service.stream,
            "control": service.control.endpoints,
            "characters": [self._described(runner, player) for runner, player in service.players],
            "status": replace(service.status, timeline=service.playback.status()).as_json(),
        }

    def calibrate(self, asked: requests.OneCharacter) -> dict[str, Any]:
        return self._cue(asked.character, "calibrate")

    def choose_user(self, asked: requests.ChooseUser) -> dict[str, Any]:
        return self._cue(asked.character, "choose_user", user=asked.user)

    def mirror(self, asked: requests.Mirror) -> dict[str, Any]:
        return self._cue(asked.character, "mirror", on=asked.on)

    def look(self, asked: requests.OneStage) -> Deferred:
        return self._service.look(self._runner(asked.stage))

    def trace(self, asked: requests.Trace) -> dict[str, Any]:
        runner = self._runner(asked.stage)
        performers = [
            {"user": user, "times": times, "positions": positions}
            for user, (times, positions) in sorted(runner.trace(asked.joint).items())
        ]
        return {"stage": runner.stage.name, "joint": asked.joint, "performers": performers}

    def record_start(self, asked: requests.RecordStart) -> dict[str, Any]:
        runner = self._runner(asked.stage)
        if self._service.reloading:
            raise ServiceError(
                f"stage {runner.stage.name}",
                found="characters that are being loaded again, which would end the take",
                expected="a stage whose characters stay",
                fix='Start the take again after the reply to {"do": "reload"}.',
            )
        takes_wait = asked.count_in and self._service.playback.takes  # which another recording forbids
        self._refuse_while_recording(*(self._service.runners if takes_wait else [runner]))
        for player in runner.stage.players:
            if not player.settled:
                raise ServiceError(
                    f"stage {runner.stage.name}",
                    found=f"a mapping of {player.character.name!r} that is still being applied",
                    expected="characters whose mappings are applied",
                    fix="Start the take again in a second; if that fails, calibrate.",
                )
        path = self._service.takes.new(asked.name, runner.stage.name)
        self._service.count_in.start(runner, path, asked.count_in)
        return {"stage": runner.stage.name, "take": path.stem, "count_in": asked.count_in}

    def record_stop(self, asked: requests.OneStage) -> Deferred | dict[str, Any]:
        runner = self._runner(asked.stage)
        counted = self._service.count_in.cancel(runner)
        if counted is not None:
            return {"stage": runner.stage.name, "take": counted, "bytes": 0}
        deferred = self._service.stop_recording(runner)
        if deferred is None:
            raise ServiceError(
                f"stage {runner.stage.name}",
                found="no take that is being recorded",
                expected="a take that is being recorded",
                fix='Start one first: {"do": "record_start"}',
            )
        return deferred

    def play_take(self, asked: requests.PlayTake) -> Deferred:
        _, player = self._player(asked.character)
        self._refuse_while_recording(*self._service.runners)
        return self._service.play_take(player, self._service.takes.path(asked.take), asked)

    def load_take(self, asked: requests.LoadTake) -> Deferred:
        _, player = self._player(asked.character)
        return self._service.load_take(player, self._service.takes.path(asked.take), asked.part)

    def pause(self, asked: requests.Switch) -> dict[str, Any]:
        return self._moved(lambda timeline, now: timeline.pause(asked.on, now))

    def seek(self, asked: requests.Seek) -> dict[str, Any]:
        return self._moved(lambda _timeline, _now: self._service.playback.seek(asked.seconds))

    def loop(self, asked: requests.Switch) -> dict[str, Any]:
        return self._moved(lambda timeline, _now: setattr(timeline, "loop", asked.on))

    def speed(self, asked: requests.Speed) -> dict[str, Any]:
        return self._moved(lambda timeline, now: timeline.set_speed(asked.factor, now))

    def stop(self, asked: requests.Stop) -> dict[str, Any]:
        playback = self._service.playback
        if asked.character is not None:
            self._player(asked.character)
        stopped = [each for each in playback.takes if asked.character in (None, each["character"])]
        playback.stop(asked.character)
        return {"stopped": stopped}

    def puppet(self, asked: requests.OneCharacter) -> dict[str, Any]:
        return self._mapping(self._player(asked.character)[1])

    def set_puppet(self, asked: requests.SetPuppet) -> dict[str, Any] | Deferred:
        _, player = self._editable(asked.character)
        puppet = puppet_of(merged(_values(player), asked.puppet), player.character.prepared.puppet.character.mesh)
        return self._show(asked.character, puppet)

    def set_handle(self, asked: requests.SetHandle) -> dict[str, Any]:
        runner, player = self._editable(asked.character)
        puppet = player.character.prepared.puppet
        names = [handle.name for handle in puppet.handle]
        if asked.handle not in names:
            raise unknown_name("the request, handle", f"no handle {asked.handle!r}", names)
        index = names.index(asked.handle)
        handle = puppet.handle[index]
        as_it_is = {"joints": handle.driven_by, "axes": handle.axes, "gain": handle.gain}
        changed = asked.model_dump(exclude_unset=True, exclude={"character", "handle"})
        return self._remap(runner, player, with_handle(puppet, index, **as_it_is | changed))

    def set_root(self, asked: requests.SetRoot) -> dict[str, Any]:
        runner, player = self._editable(asked.character)
        puppet = player.character.prepared.puppet
        changed = asked.model_dump(exclude_unset=True, exclude={"character"})
        root = None if asked.joint is None else (puppet.root or RootTable()).model_copy(update=changed)
        return self._remap(runner, player, puppet.model_copy(update={"root": root}))

    def set_scale(self, asked: requests.SetScale) -> dict[str, Any]:
        runner, player = self._editable(asked.character)
        puppet = player.character.prepared.puppet
        retarget = puppet.retarget.model_copy(update={"scale": asked.scale})
        return self._remap(runner, player, puppet.model_copy(update={"retarget": retarget}))

    def save_puppet(self, asked: requests.OneCharacter) -> Deferred:
        _, player = self._player(asked.character)
        return self._service.save(player, lambda: self._mapping(player))

    def revert_puppet(self, asked: requests.OneCharacter) -> dict[str, Any] | Deferred:
        return self._show(asked.character, self._editable(asked.character)[1].document.puppet)

    def reload(self, _: requests.Nothing) -> Deferred:
        return self._service.reload()

    def _cue(self, character: str, do: str, **arguments: object) -> dict[str, Any]:
        runner, player = self._player(character)
        self._service.show_frames(runner, runner.cue(do, character=character, **arguments))
        return self._described(runner, player)

    def _editable(self, character: str) -> tuple[StageRunner, CharacterPlayer]:
        """Find a character whose mapping may change, which it may not while a take is recorded."""
        runner, player = self._player(character)
        self._refuse_while_recording(runner)
        return runner, player

    def _show(self, character: str, puppet: Puppet) -> dict[str, Any] | Deferred:
        """Apply another mapping now, or other limbs, handles or settings when they are computed."""
        runner, player = self._editable(character)
        before = player.character.prepared.puppet
        if has_same_model(before, puppet):
            self._remap(runner, player, puppet)
            return self._mirrored(player, puppet)

        def shown(loaded: CharacterPlayer) -> dict[str, Any]:
            runner, present = self._editable(character)
            if present is not player or present.character.prepared.puppet is not before:
                raise ServiceError(
                    character,
                    found="a character that was edited or loaded again meanwhile",
                    expected="the character as it was before the edit",
                    fix="Edit it again.",
                )
            self._service.replace(runner, player, loaded)
            return self._mirrored(loaded, puppet)

        return self._service.edit(player, puppet, shown)

    def _mirrored(self, player: CharacterPlayer, puppet: Puppet) -> dict[str, Any]:
        """Mirror as a puppet says that has just been applied, and return the mapping."""
        if puppet.retarget.mirror != player.motion.mirror:
            self._cue(player.character.name, "mirror", on=puppet.retarget.mirror)
        return self._mapping(player)

    def _remap(self, runner: StageRunner, player: CharacterPlayer, puppet: Puppet) -> dict[str, Any]:
        self._service.remap(runner, player, puppet)
        return self._mapping(player)

    def _mapping(self, player: CharacterPlayer) -> dict[str, Any]:
        """Return a character's puppet, and its mapping for clients of version 0.1."""
        puppet = player.character.prepared.puppet
        deviation = puppet.smoothing.max_deviation
        return {
            "character": player.character.name,
            "puppet": _values(player),
            "handles": [
                {
                    "name": handle.name,
                    "position": list(handle.position),
                    "joints": list(handle.driven_by),
                    "axes": handle.axes,
                    "gain": handle.gain,
                }
                for handle in puppet.handle
            ],
            "limbs": [limb.model_dump(mode="json") for limb in puppet.limb],
            "root": None if puppet.root is None else puppet.root.model_dump(),
            "mirror": player.motion.mirror,
            "scale": puppet.retarget.scale,
            "smoothing": puppet.smoothing.model_dump() | {"max_deviation": deviation if isfinite(deviation) else None},
            "joints": list(JOINTS),
            "saved": puppet == player.document.puppet,
        }

    def _moved(self, move: Callable[[Timeline, float], None]) -> dict[str, Any]:
        """Change the timeline of the takes that play, and return its status."""
        playback = self._service.playback
        if not playback.takes:
            raise ServiceError(
                "the timeline",
                found="no take that plays",
                expected="a take that plays",
                fix='Play one first: {"do": "play_take", "character": "…", "take": "…"}',
            )
        self._refuse_while_recording(*self._service.runners)
        move(playback.timeline, clock.now())
        playback.changes += 1
        status = playback.status()
        return {} if status is None else asdict(status)

    def _refuse_while_recording(self, *runners: StageRunner) -> None:
        for runner in runners:
            take = runner.recording or self._service.count_in.take(runner)
            if take is not None:
                raise ServiceError(
                    f"stage {runner.stage.name}",
                    found=f"a take that is being recorded ({take!r})",
                    expected="a stage that is not recording",
                    fix='Stop it first: {"do": "record_stop"}',
                )

    def _player(self, character: str) -> tuple[StageRunner, CharacterPlayer]:
        found = self._service.find(character)
        if found is None:
            raise unknown_name("the request, character", f"no character {character!r}", self._service.names)
        return found

    def _runner(self, stage: str | None) -> StageRunner:
        runners = self._service.runners
        names = [runner.stage.name for runner in runners]
        if stage is None and len(runners) == 1:
            return runners[0]
        if stage in names:
            return runners[names.index(stage)]
        raise unknown_name("the request, stage", "nothing" if stage is None else f"no stage {stage!r}", names)

    def _described(self, runner: StageRunner, player: CharacterPlayer) -> dict[str, Any]:
        """Return the facts of a character."""
        character, take = player.character, self._service.playback.take_on(player.character.name)
        return {
            "name": character.name,
            "stage": runner.stage.name,
            "revision": character.revision,
            "vertices": len(character.rest),
            "triangles": len(character.triangles),
            "handles": [handle.name for handle in character.prepared.puppet.handle],
            "morphs": None if character.basis is None else list(character.basis.names),
            "performer": player.user,
            "take": None if take is None else take["take"],
            "state": player.state,
            "mirror": player.motion.mirror,
        }


def _values(player: CharacterPlayer) -> dict[str, Any]:
    """Return the values of a character's puppet, with mirroring as it is now."""
    return merged(values_of(player.character.prepared.puppet), {"retarget": {"mirror": player.motion.mirror}})


ARGUMENTS: dict[str, type[Table]] = {
    name: next(iter(do.__annotations__.values())) for name, do in vars(_Commands).items() if not name.startswith("_")
}
"""Every command, and its arguments, which its method is annotated with."""
