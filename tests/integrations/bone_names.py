"""Clients know the same joints of skeletons as `capture.bone_names` does.

The tests of a client derive a class from `BoneNames`, and give it the fixture `recognise`.
"""

from capture.bone_names import FINGER_BONES, MIDDLE_PARTS, SIDE_PARTS, TABLE, bone_name, find_bones

JOINTS = [*MIDDLE_PARTS, *(bone_name(side, part) for side in ("left", "right") for part in SIDE_PARTS)]
JOINTS += FINGER_BONES.values()

SPELLINGS = (
    "{s}_{}",
    "{}.{S}",
    "{Side}{}",
    "{}{Side}",
    "{side}{}",
    "mixamorig:{Side}{}",
    "Bip01 {S} {}",
    "{}_{side}_jnt",
)


def spelled(middle, sides, spelling):
    """Return the names of a skeleton's joints, without those that are empty."""
    around = spelling.replace("{s}_", "").replace("_{side}", "").replace("{S} ", "").replace(".{S}", "")
    around = around.replace("{Side}", "").replace("{side}", "")
    names = [around.format(name) for name in middle if name]
    for side in ("left", "right"):
        words = {"side": side, "Side": side.title(), "s": side[0], "S": side[0].upper()}
        names += [spelling.format(name, **words) for name in sides if name]
    return names


CONVENTIONS = {
    f"{name} {spelling}": spelled(convention["middle"], convention["sides"], spelling)
    for name, convention in TABLE["conventions"].items()
    for spelling in SPELLINGS
}

WORDS = {part: words.split() for part, words in TABLE["words"].items()}
SYNONYMS = {
    f"{k} {spelling}": spelled(
        *([WORDS[part][k % len(WORDS[part])] for part in parts] for parts in (MIDDLE_PARTS, SIDE_PARTS)), spelling
    )
    for k in range(max(len(WORDS[part]) for part in (*MIDDLE_PARTS, *SIDE_PARTS)))
    for spelling in SPELLINGS
}
"""Skeletons whose joints all have the k-th of their words."""

FINGERS = {
    "VRM 0": [f"{side}{finger}{part}" for side in ("left", "right") for finger in ("Thumb", "Little")
              for part in ("Proximal", "Intermediate", "Distal")],
    "Unreal": [f"{finger}_{part}_{s}" for s in "lr" for finger in ("thumb", "index", "pinky")
               for part in ("metacarpal", "01", "02", "03") if (finger, part) != ("thumb", "metacarpal")],
    "3ds Max": [f"Bip01 {s} Finger{finger}{k}" for s in "LR" for finger in range(5) for k in ("", 1, 2, "Nub")],
    "MikuMikuDance": [f"{side}{finger}{k}" for side in "左右" for finger in ("親指", "人指", "小指") for k in "０１２"],
}  # fmt: skip


class BoneNames:
    """`recognise` takes names of joints, and skeletons as lists of names; it returns indices by joints for each."""

    def test_joints_of_a_skeleton_are_recognised_by_every_name_in_the_table(self, recognise):
        skeletons = [*CONVENTIONS.values(), *SYNONYMS.values(), *FINGERS.values()]
        expected = [find_bones(names) for names in skeletons]
        expected = [{joint: bones[joint] for joint in JOINTS if joint in bones} for bones in expected]
        assert recognise(JOINTS, skeletons) == expected
