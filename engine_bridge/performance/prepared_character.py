"""Prepared characters: a puppet with its character, mesh and reduced model."""

import difflib
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from engine_bridge.character import own_targets
from engine_bridge.character.bodies import bodies_of, with_body
from engine_bridge.character.character import CharacterMesh, load_character
from engine_bridge.character.preparation import prepare
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.limb_nodes import limb_nodes
from engine_bridge.puppet.placement import check_handles, check_limbs
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.rig_bones import skin_shares
from puppetline.errors import PuppetError, at
from solver.model.reduced_model import ReducedModel
from solver.motion.limbs import bones_of
from solver.surface.mesh import SolverMesh


@dataclass(frozen=True, eq=False)
class PreparedCharacter:
    """A puppet, and everything that is computed once to move its character."""

    puppet: Puppet
    character: CharacterMesh
    mesh: SolverMesh
    model: ReducedModel


def cache_folder() -> Path:
    """Return the folder of the cache."""
    return platformdirs.user_cache_path("puppetline") / "models"


def load_prepared(path: Path) -> PreparedCharacter:
    """Load a puppet file and prepare its character, with a cache.

    Raises
    ------
    PuppetlineError
    """
    return prepared_of(puppet_file.load(path), path)


def prepared_of(puppet: Puppet, path: Path) -> PreparedCharacter:
    """Prepare the character of a puppet from a file.

    Raises
    ------
    PuppetlineError
    """
    file = path.parent / puppet.character.mesh
    if not file.is_file():
        raise PuppetError(
            at(path, field="[character], mesh"),
            found=f"{puppet.character.mesh!r}, which leads to the missing file {file}",
            expected="the path of a mesh relative to the puppet file",
            fix="Correct the path, or copy the mesh there.",
        )
    character = load_character(file, cache_folder())
    if puppet.character.body is not None:
        where = at(path, field="[character], body")
        character = with_body(character, bodies_of(character), puppet.character.body, where)
    limb_nodes(puppet, character, path)  # refuses those of another mesh
    prepared = make_prepared(puppet, character)
    check_limbs(puppet.limb, prepared.mesh, path)
    check_handles(puppet.handle, prepared.mesh, path)
    _check_morphs(prepared, path)
    return prepared


def _check_morphs(prepared: PreparedCharacter, path: Path) -> None:
    """Refuse morph targets that the mesh does not have."""
    names = own_targets.names_of(prepared.character) if prepared.puppet.morph else []
    for number, morph in enumerate(prepared.puppet.morph, 1):
        if morph.target not in names:
            close = difflib.get_close_matches(morph.target, names, 1)
            raise PuppetError(
                at(path, field=f"[[morph]] {number}, target"),
                found=f"{morph.target!r}, which is not a morph target of {prepared.puppet.character.mesh}",
                expected=f"one of {', '.join(names)}" if names else "a mesh with named morph targets",
                fix=f"Did you mean {close[0]!r}?" if close else "Correct the name, or remove the table.",
            )


def make_prepared(puppet: Puppet, character: CharacterMesh) -> PreparedCharacter:
    """Prepare a character for a puppet."""
    mesh, model = prepare(
        character.vertices,
        character.triangles,
        puppet.solver.parameters,
        cache_folder(),
        character.document.name,
        bones=bones_of(puppet.limbs, puppet.character.basis[1]),
        shares=skin_shares(character, puppet),
    )
    return PreparedCharacter(puppet, character, mesh, model)
