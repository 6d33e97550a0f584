"""Calibrations stored on disk, so that performers resume immediately after a restart of the service."""

import json
import logging
from pathlib import Path
from typing import Any

import platformdirs

from engine_bridge.performance.calibration import Calibration
from engine_bridge.service.stages.stage import Stage
from puppetline import clock
from puppetline.errors import OutputError
from puppetline.files import written_whole

VERSION = 3

log = logging.getLogger(__name__)


def state_file() -> Path:
    """Return the path of the file with the stored calibrations."""
    return platformdirs.user_state_path("puppetline") / "performers.json"


def known_performers(stages: dict[str, tuple[Stage, float]]) -> Any:
    """Return the calibrations of stages in JSON's types.

    Parameters
    ----------
    stages : dict
        From each source's URI to its stage and the time on its clock.

    Returns
    -------
    JSON
    """
    ages = [
        [uri, player.character.name, user, now - seen, calibration.to_json()]
        for uri, (stage, now) in stages.items()
        for player in stage.players
        for user, (calibration, seen) in player.remembered().items()
    ]
    return {"version": VERSION, "written": clock.wall(), "performers": ages}


def write(known: Any, path: Path) -> None:
    """Write the value of `known_performers`; log a warning if that fails."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as beside:
            beside.write_text(json.dumps(known), encoding="utf-8")
    except (OSError, OutputError) as error:
        log.warning("could not save calibrations: %s", error)


def recall(stages: dict[str, tuple[Stage, float]], path: Path) -> None:
    """Restore the calibrations of an earlier run; ignore a missing, damaged or older file."""
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        if known["version"] != VERSION:
            return
        away = max(0.0, clock.wall() - known["written"])
        performers = [
            (uri, name, int(user), float(age) + away, Calibration.of_json(known_as))
            for uri, name, user, age, known_as in known["performers"]
        ]
    except FileNotFoundError:
        return
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        log.warning("calibrations of the last run cannot be read (%s): %s", path, error)
        return
    for uri, (stage, now) in stages.items():
        for player in stage.players:
            player.remember(
                {
                    user: (calibration, now - age)
                    for at, name, user, age, calibration in performers
                    if (at, name) == (uri, player.character.name)
                }
            )
