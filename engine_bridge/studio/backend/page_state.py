"""Builds the state that pages show from its parts."""

import hashlib
import json
from typing import TYPE_CHECKING, Any

from engine_bridge.studio.messages import state
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.service.chosen_source import ChosenSource
from engine_bridge.studio.service.service_link import ServiceLink

if TYPE_CHECKING:
    from engine_bridge.studio.project.open_characters import OpenCharacter  # importing it takes a while


def character_state(character: "OpenCharacter", described: dict[str, Any]) -> state.CharacterState:
    """Return the state of a character; `described` is the service's entry of `describe`, empty if it has none."""
    return state.CharacterState(
        name=character.name,
        title=character.title,
        stage=described.get("stage", ""),
        limbs=[limb["name"] for limb in character.puppet["limb"]],
        handles=[handle["name"] for handle in character.puppet["handle"]],
        targets=character.targets,
        vertices=character.vertices,
        triangles=character.triangles,
        version=version_of(character.puppet),
        saved=character.puppet == character.saved,
        model="" if character.model is None else character.model.id,
        notes=character.notes,
        performer=described.get("performer"),
        state=described.get("state", "waiting"),
        mirror=described.get("mirror", character.puppet["retarget"]["mirror"]),
    )


def version_of(puppet: dict[str, Any]) -> str:
    """Return a hash of a puppet's values, by which a page detects a change."""
    return hashlib.sha256(json.dumps(puppet, sort_keys=True).encode()).hexdigest()[:16]


def state_of(
    characters: list[state.CharacterState],
    playing: ChosenSource,
    service: ServiceLink,
    takes: list[state.TakeState],
    workspace: Workspace,
    jobs: list[state.JobState],
    recording: str | None,
) -> state.State:
    """Return the whole state."""
    status = service.status
    stages = [_stage(each, playing) for each in status.get("stages", [])]
    rates = {each["name"]: each["rate"] for each in status.get("characters", [])}
    characters = [each.model_copy(update={"rate": rates.get(each.name, 0.0)}) for each in characters]
    performers = [_performer(user, stage["name"]) for stage in status.get("stages", []) for user in stage["users"]]
    return state.State(
        characters=characters,
        source=playing.state,
        stages=stages,
        service=service.state,
        performers=performers,
        recording=recording,
        takes=takes,
        timeline=status.get("timeline"),
        uploads=[
            state.UploadState(upload=each.id, name=each.name, kind=each.kind, bytes=each.bytes, facts=each.facts)
            for each in workspace.uploads.values()
        ],
        files=[
            state.FileState.model_validate({"file": each.id, "name": each.name, "bytes": each.bytes, "kind": each.kind})
            for each in workspace.downloads.values()
            if each.kind != "model"
        ],
        jobs=jobs,
        status=_numbers(status),
        banner=_banner(characters, playing.state, service.state, stages, performers),
    )


def _stage(stage: dict[str, Any], playing: ChosenSource) -> state.StageState:
    known = {key: stage[key] for key in ("name", "rate", "refused", "recording")}
    source = playing.state.uri if stage["source"] == playing.uri else stage["source"]
    return state.StageState(source=source, count_in=stage.get("count_in", 0), **known)


def _performer(user: dict[str, Any], stage: str) -> state.PerformerState:
    known = {key: user[key] for key in state.PerformerState.model_fields if key != "stage"}
    return state.PerformerState(stage=stage, **known)


def _numbers(status: dict[str, Any]) -> state.StatusState:
    if not status:
        return state.StatusState()
    latencies = [each["latency_ms"]["p50"] for each in status["stages"]]
    known = [each for each in latencies if each is not None]
    outputs = status["outputs"]
    return state.StatusState(
        fps=sum(each["rate"] for each in status["stages"]),
        latency_ms=max(known, default=None),
        clients=status["clients"]["connected"] + sum(each.get("clients") or 0 for each in outputs),
        drops=sum(each["dropped"] for each in status["stages"]) + sum(each["skipped"] or 0 for each in outputs),
    )


def _banner(
    characters: list[state.CharacterState],
    source: state.SourceState,
    service: state.ServiceState,
    stages: list[state.StageState],
    performers: list[state.PerformerState],
) -> state.Banner:
    """Return the most important message: about the service first, then characters, the source, and performers."""
    if service.problem and not service.running and not service.restarts:  # the service was started elsewhere
        return state.Banner(level="error", text=service.problem, fix="Start it, or check its address and token.")
    if not characters:
        return state.Banner(level="info", text="No character is open.", fix="Drop a mesh here, or open an example.")
    if not service.running:
        if service.restarts:
            return state.Banner(
                level="error",
                text=f"The service has ended and is started again. {service.problem}".strip(),
                fix="Wait a few seconds. If this repeats, choose another source or close the last character.",
            )
        fix = "This takes about a quarter of a minute." if service.text else "Wait a few seconds."
        return state.Banner(level="info", text=f"The service starts. {service.text}".strip(), fix=fix)
    if source.kind == "none":
        return state.Banner(
            level="info", text="No source is chosen.", fix="Choose an example, a recording or a sensor."
        )
    refused = sorted({reason for stage in stages for reason in stage.refused})
    if source.kind == "live" and not performers and refused:
        return state.Banner(
            level="warning",
            text=f"Packets arrive that are not understood: {', '.join(refused)}.",
            fix="Check the settings of the program that sends them.",
        )
    if source.kind == "live" and not performers:
        return state.Banner(
            level="warning",
            text=f"No performer is in view of {source.text}.",
            fix="Stand 2 m in front of the sensor, completely in view. Look at its image for the reason.",
        )
    if any(each.state == "calibrating" for each in characters):
        return state.Banner(level="info", text="A performer is being calibrated.", fix="Stand still for a second.")
    return state.Banner()
