"""What can be asked of the service over the control socket (docs/control.md), done."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from capture.skeleton import JOINTS
from engine_bridge.puppet.puppet import Puppet, RootTable, with_handle
from engine_bridge.service.character_player import Role
from engine_bridge.service.control import requests
from engine_bridge.service.control.control_socket import Command, Deferred
from engine_bridge.service.service import Service
from engine_bridge.service.stage_runner import Line
from puppetline.errors import ServiceError


def commands(service: Service) -> Mapping[str, Command]:
    """Bind all commands to a service."""
    done = _Commands(service)
    return {name: (arguments, getattr(done, name)) for name, arguments in requests.ARGUMENTS.items()}


class _Commands:
    """Each command under its name."""

    def __init__(self, service: Service) -> None:
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

    def calibrate(self, asked: requests.OneCharacter) -> dict[str, Any]:
        return self._cue(asked.character, "calibrate")

    def choose_user(self, asked: requests.ChooseUser) -> dict[str, Any]:
        return self._cue(asked.character, "choose_user", user=asked.user)

    def mirror(self, asked: requests.Mirror) -> dict[str, Any]:
        return self._cue(asked.character, "mirror", on=asked.on)

    def record_start(self, asked: requests.RecordStart) -> dict[str, Any]:
        line = self._line(asked.stage)
        _refuse_while_recording(line)
        for role in line.stage.roles:
            if not role.settled:
                raise ServiceError(
                    f"stage {line.stage.name}",
                    found=f"a mapping of {role.character.name!r} that is just changing",
                    expected="characters that move as their puppets say",
                    fix="Start again in a second; calibrate if that does not help.",
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

    def puppet(self, asked: requests.OneCharacter) -> dict[str, Any]:
        return self._mapping(self._role(asked.character)[1])

    def set_handle(self, asked: requests.SetHandle) -> dict[str, Any]:
        line, role = self._editable(asked.character)
        puppet = role.character.rig.puppet
        names = [handle.name for handle in puppet.handle]
        if asked.handle not in names:
            raise ServiceError(
                "the request, handle",
                found=f"no handle {asked.handle!r}",
                expected=f"one of {', '.join(names)}",
                fix="Name one of these.",
            )
        index = names.index(asked.handle)
        handle = puppet.handle[index]
        as_it_is = {"joints": handle.driven_by, "axes": handle.axes, "gain": handle.gain}
        changed = asked.model_dump(exclude_unset=True, exclude={"character", "handle"})
        return self._remap(line, role, with_handle(puppet, index, **as_it_is | changed))

    def set_root(self, asked: requests.SetRoot) -> dict[str, Any]:
        line, role = self._editable(asked.character)
        puppet = role.character.rig.puppet
        changed = asked.model_dump(exclude_unset=True, exclude={"character"})
        root = None if asked.joint is None else (puppet.root or RootTable()).model_copy(update=changed)
        return self._remap(line, role, puppet.model_copy(update={"root": root}))

    def set_scale(self, asked: requests.SetScale) -> dict[str, Any]:
        line, role = self._editable(asked.character)
        puppet = role.character.rig.puppet
        retarget = puppet.retarget.model_copy(update={"scale": asked.scale})
        return self._remap(line, role, puppet.model_copy(update={"retarget": retarget}))

    def save_puppet(self, asked: requests.OneCharacter) -> Deferred:
        _, role = self._role(asked.character)
        return self._service.save(role, lambda: self._mapping(role))

    def revert_puppet(self, asked: requests.OneCharacter) -> dict[str, Any]:
        line, role = self._editable(asked.character)
        return self._remap(line, role, self._service.document(role).puppet)

    def reload(self, _: requests.Nothing) -> Deferred:
        return self._service.reload()

    def _cue(self, character: str, do: str, **arguments: object) -> dict[str, Any]:
        line, role = self._role(character)
        self._service.show_frames(line, line.cue(do, character=character, **arguments))
        return _described(line, role)

    def _editable(self, character: str) -> tuple[Line, Role]:
        """Find a character whose mapping may change: a take is of one mapping from beginning to end."""
        line, role = self._role(character)
        _refuse_while_recording(line)
        return line, role

    def _remap(self, line: Line, role: Role, puppet: Puppet) -> dict[str, Any]:
        self._service.remap(line, role, puppet)
        return self._mapping(role)

    def _mapping(self, role: Role) -> dict[str, Any]:
        """Return what is to be known of a puppet's mapping."""
        puppet = role.character.rig.puppet
        deviation = puppet.smoothing.max_deviation
        return {
            "character": role.character.name,
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
            "root": None if puppet.root is None else puppet.root.model_dump(),
            "mirror": role.mirror,
            "scale": puppet.retarget.scale,
            "smoothing": puppet.smoothing.model_dump() | {"max_deviation": deviation if isfinite(deviation) else None},
            "joints": list(JOINTS),
            "saved": puppet == self._service.document(role).puppet,
        }

    def _role(self, character: str) -> tuple[Line, Role]:
        for line in self._service.lines:
            for role in line.stage.roles:
                if role.character.name == character:
                    return line, role
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


def _refuse_while_recording(line: Line) -> None:
    if line.recording is not None:
        raise ServiceError(
            f"stage {line.stage.name}",
            found=f"that the take {line.recording!r} is being recorded",
            expected="a stage that is not",
            fix='Stop it first: {"do": "record_stop"}',
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
