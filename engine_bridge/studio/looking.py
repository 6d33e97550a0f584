"""Why nothing moves, as far as the status of the service shows it."""

from collections.abc import Iterator

from engine_bridge.studio.messages import Banner, LookReply, PerformerState, StageState, State

MIN_RATE = 12.0
"""Skeletons per second below which motion visibly stutters."""


def look(state: State) -> LookReply:
    """Return what the source of the stages delivers, and what is wrong with it; without a picture."""
    problems = list(_problems(state))
    return LookReply(picture="", problems=problems, performers=[_line(each) for each in state.performers])


def _problems(state: State) -> Iterator[Banner]:
    if not state.service.running:
        yield state.banner
        return
    for stage in state.stages:
        if stage.refused:
            yield Banner(
                level="warning",
                text=f"{stage.source}: packets that are not understood ({_counted(stage.refused)}).",
                fix="Check the settings of the program that sends them.",
            )
        users = [each for each in state.performers if each.stage == stage.name]
        if not users:
            yield _absence(stage)
        elif 0 < stage.rate / len(users) < MIN_RATE:
            yield Banner(
                level="warning",
                text=f"{stage.source}: only {stage.rate / len(users):.0f} skeletons per second arrive.",
                fix="Give a camera more light, or reduce the load of this machine or the network.",
            )


def _absence(stage: StageState) -> Banner:
    if stage.source.startswith(("osc:", "vmc:")) and not stage.refused:
        return Banner(
            level="warning",
            text=f"Nothing arrives at {stage.source}.",
            fix="Start the program that sends skeletons, and enter this machine's address and this port there.",
        )
    return Banner(
        level="warning",
        text=f"No performer is in view of {stage.source}.",
        fix="Stand 2 m in front of the sensor, completely in view, with light from the front.",
    )


def _line(performer: PerformerState) -> str:
    drives = "drives no character" if performer.character is None else f"drives {performer.character}"
    return f"user {performer.user}: {performer.distance:.2f} m away, {performer.state}, {drives}"


def _counted(refused: dict[str, int]) -> str:
    return ", ".join(f"{reason}: {count}" for reason, count in sorted(refused.items()))
