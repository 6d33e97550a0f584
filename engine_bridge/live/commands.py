"""What can be asked of the service over the control socket (docs/control.md), done."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from engine_bridge.live import requests
from engine_bridge.live.control import Command, Deferred
from engine_bridge.live.line import Line
from engine_bridge.live.role import Role
from puppetline.errors import ServiceError

if TYPE_CHECKING:
    from engine_bridge.live.service import Service


def commands(service: "Service") -> Mapping[str, Command]:
    """Bind all commands to a service."""
    done = _Commands(service)
    return {name: (arguments, getattr(done, name)) for name, arguments in requests.ARGUMENTS.items()}


class _Commands:
    """Each command under its name."""

    def __init__(self, service: "Service") -> None:
        self._service = service

    def ping(self, _: requests.Nothing) -> str:
        return "pong"

    def list(self, _: requests.Nothing) -> dict[str, Any]:
        return {
            "characters": [role.character.name for line in self._service.lines for role in line.stage.roles],
            "stages": [line.stage.name for line in self._service.lines],
            "takes": self._service.takes.all(),
            "commands": [*requests.ARGUMENTS],
        }

    def describe(self, _: requests.Nothing) -> dict[str, Any]:
        service = self._service
        return {
            "protocol": 1,
            "stream": service.publisher.endpoints,
            "control": service.control.endpoints,
            "characters": [_described(line, role) for line in service.lines for role in line.stage.roles],
            "status": service.status,
        }

    def calibrate(self, asked: requests.Calibrate) -> dict[str, Any]:
        return self._cue(asked.character, "calibrate")

    def choose_user(self, asked: requests.ChooseUser) -> dict[str, Any]:
        return self._cue(asked.character, "choose_user", user=asked.user)

    def mirror(self, asked: requests.Mirror) -> dict[str, Any]:
        return self._cue(asked.character, "mirror", on=asked.on)

    def record_start(self, asked: requests.RecordStart) -> dict[str, Any]:
        line = self._line(asked.stage)
        if line.recording is not None:
            raise ServiceError(
                f"stage {line.stage.name}",
                found=f"that the take {line.recording!r} is being recorded",
                expected="a stage that is not",
                fix='Stop it first: {"do": "record_stop"}',
            )
        path = self._service.takes.new(asked.name, line.stage.name)
        line.start_recording(path)
        return {"stage": line.stage.name, "take": path.stem}

    def record_stop(self, asked: requests.RecordStop) -> Deferred:
        line = self._line(asked.stage)
        deferred = self._service.stop_recording(line)
        if deferred is None:
            raise ServiceError(
                f"stage {line.stage.name}",
                found="no take that is being recorded",
                expected="one",
                fix='Start one first: {"do": "record_start"}',
            )
        return deferred

    def reload(self, _: requests.Nothing) -> Deferred:
        return self._service.reload()

    def _cue(self, character: str, do: str, **arguments: object) -> dict[str, Any]:
        for line in self._service.lines:
            for role in line.stage.roles:
                if role.character.name == character:
                    self._service.show_frames(line, line.cue(do, character=character, **arguments))
                    return _described(line, role)
        names = [role.character.name for line in self._service.lines for role in line.stage.roles]
        raise ServiceError(
            "the request, character",
            found=f"no character {character!r}",
            expected=f"one of {', '.join(names)}",
            fix="Name one of these.",
        )

    def _line(self, stage: str | None) -> Line:
        lines = self._service.lines
        names = [line.stage.name for line in lines]
        if stage is None and len(lines) == 1:
            return lines[0]
        if stage in names:
            return lines[names.index(stage)]
        raise ServiceError(
            "the request, stage",
            found="nothing" if stage is None else f"no stage {stage!r}",
            expected=f"one of {', '.join(names)}",
            fix="Name one of these.",
        )


def _described(line: Line, role: Role) -> dict[str, Any]:
    """Return what is to be known of a character."""
    character = role.character
    return {
        "name": character.name,
        "stage": line.stage.name,
        "revision": character.revision,
        "vertices": len(character.rest),
        "triangles": len(character.triangles),
        "handles": [handle.name for handle in character.rig.puppet.handle],
        "morphs": None if character.basis is None else list(character.basis.names),
        "performer": role.user,
        "state": role.state,
        "mirror": role.mirror,
    }
