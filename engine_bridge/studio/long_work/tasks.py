"""The studio's tasks that take long, run in a `Worker`: each function's first argument reports its progress."""

import hashlib
import math
import os
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from capture.formats import read_log
from capture.recording import Recorder
from capture.sources.demo import performances
from engine_bridge.character import examples, own_targets
from engine_bridge.export.convert import convert, describe
from engine_bridge.export.performer import convert as performer_conversion
from engine_bridge.export.shader_mesh import write_shader_mesh
from engine_bridge.film.film import first_frame, make_video
from engine_bridge.film.sharing import share_video
from engine_bridge.inspection import files, sensors
from engine_bridge.performance.prepared_character import PreparedCharacter, prepared_of
from engine_bridge.performance.settings import Form, Settings
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.puppet.puppet_values import puppet_of, values_of
from engine_bridge.studio.long_work import film_plans, take_pictures
from engine_bridge.studio.long_work.installation import install_extra
from engine_bridge.studio.long_work.media import media_kind
from engine_bridge.studio.long_work.trimming import trimmed
from engine_bridge.studio.long_work.worker import Progress
from puppetline.errors import PuppetlineError
from puppetline.files import written_whole

LIVE = "live.toml"
"""Name of the puppet file that the service loads, in a character's folder."""

MODEL = "model.glb"
"""Name of the file with the character at rest for the page's shader, in the same folder."""


def inspect(_progress: Progress, path: Path) -> dict[str, Any]:
    """Return what `puppetline inspect` reports about a file; of a video, a sound or a picture, its kind."""
    kind = media_kind(path)
    return files.inspect(path) if kind is None else {"kind": kind}


def propose(progress: Progress, mesh: Path, folder: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Propose a puppet for a mesh, write it to a character's folder, and prepare it; see `prepare`."""
    progress("Looking for limbs", 0.0)
    copy, saved = folder / mesh.name, folder / f"{folder.name}.toml"
    shutil.copyfile(mesh, copy)
    proposed = new_puppet(copy, saved, **options)
    puppet_file.dump(proposed.puppet, saved)
    notes = [*(f"Assumed: {each}." for each in proposed.assumed), *proposed.notes]
    return prepare(progress, saved, folder) | {"notes": notes}


def open_puppet(progress: Progress, puppet: Path, mesh: Path, folder: Path) -> dict[str, Any]:
    """Copy a puppet file and its mesh to a character's folder, and prepare them; see `prepare`.

    The copy differs from the file in the name of the mesh only.
    """
    text = puppet_file.read(puppet)
    puppet_file.loads(text, puppet)
    copy, saved = folder / mesh.name, folder / f"{folder.name}.toml"
    shutil.copyfile(mesh, copy)
    document = tomlkit.parse(text)
    document["character"]["mesh"] = copy.name
    saved.write_bytes(tomlkit.dumps(document).encode())
    return prepare(progress, saved, folder)


def open_example(progress: Progress, name: str, made: Path, folder: Path) -> dict[str, Any]:
    """Copy an example character, which is made once, to a character's folder, and prepare it; see `prepare`."""
    if not (made / f"{examples.MOTIONS[name]}.log").exists():  # the last of the files that are made
        examples.prepare(name, made, progress)
    return open_puppet(progress, made / f"{name}.toml", made / f"{name}.glb", folder)


def prepare(progress: Progress, saved: Path, folder: Path) -> dict[str, Any]:
    """Prepare a character: compute its model, and write the puppet file that the service loads and the page's model.

    Parameters
    ----------
    progress : callable
    saved : Path
        Puppet file.
    folder : Path
        Of the character.

    Returns
    -------
    dict
        ``puppet`` (see `values_of`), ``targets`` (names), ``vertices``, ``triangles``, ``width`` (metres), ``digest``
        (of the isoline coordinates), ``notes``, and ``model``: whether there is a file `MODEL`.
    """
    progress("Preparing the character", 0.0)
    puppet = puppet_file.load(saved)
    mesh = saved.parent / puppet.character.mesh
    live = folder / LIVE
    moved = puppet.character.model_copy(update={"mesh": Path(os.path.relpath(mesh, folder)).as_posix()})
    return _applied(progress, puppet.model_copy(update={"character": moved}), live)


def edit(progress: Progress, folder: Path, values: dict[str, Any]) -> dict[str, Any]:
    """Replace the puppet in the file that the service loads; the mesh stays. Returns what `prepare` does.

    Raises
    ------
    PuppetError
        The values are not a puppet, or do not fit the mesh; nothing changes.
    """
    live = folder / LIVE
    return _applied(progress, puppet_of(values, puppet_file.load(live).character.mesh), live)


def save(_progress: Progress, saved: Path, folder: Path) -> None:
    """Write the puppet that the service loads into the saved file, whose comments and order are kept."""
    document, live = PuppetDocument(saved), puppet_file.load(folder / LIVE)
    character = live.character.model_copy(update={"mesh": document.puppet.character.mesh})
    document.save(live.model_copy(update={"character": character}))


def _applied(progress: Progress, puppet: Puppet, live: Path) -> dict[str, Any]:
    prepared = prepared_of(puppet, live)
    progress("Preparing the character", 0.5)
    puppet_file.dump(puppet, live)
    digest = _digest(prepared)
    notes, has_model = [], True
    model = live.with_name(MODEL)
    stamp = model.with_suffix(".txt")
    if not (model.exists() and stamp.exists() and stamp.read_text(encoding="ascii") == digest):
        try:
            write_shader_mesh(live, model)
            stamp.write_text(digest, encoding="ascii")
        except PuppetlineError as error:  # for example more fields than a shader has attributes for
            notes.append(f"The character is drawn without its materials: {error}")
            model.unlink(missing_ok=True)
            has_model = False
    progress("Preparing the character", 1.0)
    return {
        "puppet": values_of(puppet),
        "targets": own_targets.names_of(prepared.character),
        "vertices": len(prepared.character.vertices),
        "width": float(np.ptp(prepared.character.vertices @ puppet.character.basis[0])) * puppet.character.scale,
        "triangles": len(prepared.character.triangles),
        "digest": digest,
        "model": has_model,
        "notes": [*notes, *prepared.character.document.notes],
    }


def _digest(prepared: PreparedCharacter) -> str:
    """Return a hash of what the page's model depends on."""
    arrays = prepared.model.isoline_coordinates.tobytes() + prepared.character.vertices.tobytes()
    return hashlib.sha256(arrays + "\0".join(prepared.puppet.targets).encode()).hexdigest()


def values_of_file(_progress: Progress, path: Path) -> dict[str, Any]:
    """Return all values of a puppet file, see `values_of`."""
    return values_of(puppet_file.load(path))


def export(
    progress: Progress, log: Path, folder: Path, output: Path, form: Form | None, start: float, stop: float | None
) -> dict[str, Any]:
    """Convert a recording for a character; returns the numbers and the text of `puppetline convert`."""
    _, summary = convert(log, folder / LIVE, output, Settings(form=form, start=start, stop=stop), progress)
    return {
        "numbers": asdict(summary) | {"output": output.name},
        "text": describe(replace(summary, output=output.name)),
    }


def export_performer(progress: Progress, log: Path, output: Path, start: float, stop: float | None) -> dict[str, Any]:
    """Convert a recording to an animation of the performer who is tracked longest, like `export`."""
    performers = performer_conversion.upright_performers(read_log(log))
    summary = performer_conversion.convert_performer(
        performers, log, output, log.stem, Settings(start=start, stop=stop), progress
    )
    return {
        "numbers": asdict(summary) | {"output": output.name},
        "text": performer_conversion.describe([replace(summary, output=output.name)]),
    }


def write_example(_progress: Progress, name: str, path: Path) -> None:
    """Write an example motion as a recording."""
    with written_whole(path) as beside, Recorder(beside) as recorder:
        for frame in performances()[name]().frames():
            recorder.write(frame)


def trim(_progress: Progress, log: Path, path: Path, start: float | None, stop: float | None) -> None:
    """Write the part of a recording from one second to another, see `engine_bridge.studio.long_work.trimming`."""
    trimmed(log, path, start or 0.0, math.inf if stop is None else stop)


def draw_take(_progress: Progress, puppet: Path, log: Path, path: Path) -> None:
    """Draw a character in a take, see `engine_bridge.studio.long_work.take_pictures`."""
    take_pictures.draw_take(puppet, log, path)


def draw_wave(_progress: Progress, sound: Path, path: Path) -> None:
    """Draw the wave form of a sound."""
    take_pictures.draw_wave(sound, path)


def make_film(progress: Progress, scene: Path, output: Path) -> dict[str, Any]:
    """Make a video of a scene file, and return its duration and notes."""
    summary = make_video(scene, output, 0.0, None, False, progress)
    return {"seconds": summary.seconds, "notes": list(summary.notes)}


def plan_film(progress: Progress, scene: Path) -> dict[str, Any]:
    """Return the plan of a scene file, see `engine_bridge.studio.long_work.film_plans`."""
    return film_plans.plan_for_page(scene, progress).model_dump(mode="json")


def begin_film(progress: Progress, scene: Path) -> None:
    """Do what takes long before the first frame of a film can be drawn."""
    first_frame(scene, progress)


def share_film(_progress: Progress, video: Path) -> None:
    """Write a poster and a .gif beside a video."""
    share_video(video)


def install(progress: Progress, extra: str) -> None:
    """Install the packages of an extra."""
    install_extra(extra, progress)


def devices(_progress: Progress) -> list[dict[str, Any]]:
    """Return sensors, cameras, and the libraries that read them."""
    return [asdict(each) for each in sensors.examine()]


AFTERWARDS = {"plan_film": begin_film}
"""What a worker does after a task, with the same arguments, because it is probably needed next."""
