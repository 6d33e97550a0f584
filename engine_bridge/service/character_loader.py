"""The characters of a service, loaded from their puppet files, once and again."""

import hashlib
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from weakref import WeakKeyDictionary

from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.performance.humanoid import LIMBS, UPRIGHT, is_humanoid
from engine_bridge.performance.rig import rig_of
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.service.character_player import Role
from engine_bridge.service.protocol.frame import StreamedCharacter
from engine_bridge.service.service_file import CharacterTable, ServiceFile, StageTable, character_names
from puppetline.errors import PuppetError, at
from solver.motion.limbs import TRUNK


class Cast:
    """Loads the characters that the settings name.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        What files are relative to.
    executor : Executor
        Of the roles' calibrations.
    """

    def __init__(self, settings: ServiceFile, folder: Path, executor: Executor) -> None:
        self._settings, self._folder, self._executor = settings, folder, executor
        self._documents: WeakKeyDictionary[Role, PuppetDocument] = WeakKeyDictionary()
        self._sent_as_vmc = {
            name for target in settings.osc if "vmc" in target.send for name in settings.receives(target)
        }

    def load(self) -> list[list[Role]]:
        """Return the roles of each stage.

        Raises
        ------
        PuppetlineError
            The first thing that is wrong with one of the files.
        """
        return [
            [
                self._role(stage, table, name)
                for table, name in zip(stage.character, character_names(stage), strict=True)
            ]
            for stage in self._settings.stage
        ]

    def document(self, role: Role) -> PuppetDocument:
        """Return the file that a role's puppet was loaded from."""
        return self._documents[role]

    def _role(self, stage: StageTable, table: CharacterTable, name: str) -> Role:
        document = PuppetDocument(self._folder / table.puppet)
        if name in self._sent_as_vmc and not is_humanoid(document.puppet):
            raise _no_humanoid(document)
        rig = rig_of(document.puppet, document.path)
        basis = None if table.morphs is None else LiveBasis.load(self._folder / table.morphs, rig)
        character = StreamedCharacter(name, rig, 0, basis)
        character = replace(character, revision=_revision(character))
        character.prepare()  # here, and not when the first client asks for it
        idle = None if table.idle is None else self._folder / table.idle
        role = Role(character, stage.manner, self._executor, idle)
        self._documents[role] = document
        return role


def _no_humanoid(document: PuppetDocument) -> PuppetError:
    names = [limb.name for limb in document.puppet.limb]
    sided = ", ".join(name for name in LIMBS if name not in UPRIGHT)
    return PuppetError(
        at(document.path, field="[[limb]]"),
        found=f"the limbs {', '.join(names)}" if names else "no limb",
        expected=f"a limb {TRUNK} and one or more of {sided}, to send VMC",
        fix='Name its limbs so, as puppetline new does, or take "vmc" out of send.',
    )


def _revision(character: StreamedCharacter) -> int:
    """Make a number of all that a client knows of a character; after a restart it is the same."""
    digest = hashlib.sha256(character.scene)
    if character.basis is not None:
        digest.update(character.basis.targets.tobytes())
    return int.from_bytes(digest.digest()[:4], "little")
