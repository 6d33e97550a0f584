"""Recordings of animals on four legs, whose motion a character on four legs takes over joint by joint.

In such a recording, the forelegs are arms. Front legs of a character follow arms anyway; of an animal, all legs, the
trunk and the neck point as the animal's do, instead of stepping or turning as a person's do.
"""

from engine_bridge.puppet.puppet import LimbTable, Puppet
from puppetline.errors import SkeletonLogError
from solver.motion.limbs import TRUNK

LEGS = 4
"""Number of legs of an animal and of the characters that can follow it."""

POINTING = (TRUNK, "neck", "head")
"""Limbs beside the legs that point as the animal's do; others rest on what carries them, because it has none."""


def of_animal(puppet: Puppet) -> Puppet:
    """Return a puppet whose legs, trunk and neck point as an animal's do.

    Raises
    ------
    SkeletonLogError
        The character does not stand on four legs.
    """
    legs = sum(limb.stands and limb.name != TRUNK for limb in puppet.limb)
    if legs != LEGS:
        raise SkeletonLogError(
            "the recording",
            found=f"a four-legged skeleton, for a character on {legs or 'no'} legs that step",
            expected="a person, or a character on four legs",
            fix="Use a recording of a person, choose another character, or read it as a person with --as-person.",
        )
    return puppet.model_copy(update={"limb": tuple(_of_animal(limb) for limb in puppet.limb)})


def _of_animal(limb: LimbTable) -> LimbTable:
    if limb.stands or limb.name in POINTING:
        return limb.model_copy(update={"follow": "direction", "gain": 1.0})
    return limb.model_copy(update={"gain": 0.0})
