"""Usual names of the morph targets of faces: those of VRM 0 and 1, VRoid Studio, visemes and ARKit."""

from collections.abc import Sequence

_SIDES = ("Left", "Right")

EXPRESSION_TARGETS: dict[str, tuple[tuple[str, ...], ...]] = {
    "aa": (("aa",), ("viseme_aa",), ("Fcl_MTH_A",), ("A",), ("jawOpen",)),
    "ih": (("ih",), ("viseme_I",), ("Fcl_MTH_I",), ("I",)),
    "ou": (("ou",), ("viseme_U",), ("Fcl_MTH_U",), ("U",), ("mouthPucker",)),
    "ee": (("ee",), ("viseme_E",), ("Fcl_MTH_E",), ("E",)),
    "oh": (("oh",), ("viseme_O",), ("Fcl_MTH_O",), ("O",), ("mouthFunnel",)),
    "blink": (
        ("blink",),
        ("Fcl_EYE_Close",),
        ("eyesClosed",),
        tuple(f"eyeBlink{side}" for side in _SIDES),
        tuple(f"eyeBlink_{side[0]}" for side in _SIDES),
        tuple(f"blink{side}" for side in _SIDES),
    ),
    **{
        f"blink{side}": (
            (f"blink{side}",),
            (f"blink_{side[0]}",),
            (f"Fcl_EYE_Close_{side[0]}",),
            (f"eyeBlink{side}",),
            (f"eyeBlink_{side[0]}",),
        )
        for side in _SIDES
    },
    "happy": (("happy",), ("joy",), ("Fcl_ALL_Joy",), ("mouthSmileLeft", "mouthSmileRight")),
    "angry": (("angry",), ("Fcl_ALL_Angry",)),
    "sad": (("sad",), ("sorrow",), ("Fcl_ALL_Sorrow",), ("mouthFrownLeft", "mouthFrownRight")),
    "relaxed": (("relaxed",), ("fun",), ("Fcl_ALL_Fun",)),
    "surprised": (("surprised",), ("Fcl_ALL_Surprised",)),
    "neutral": (("neutral",), ("Fcl_ALL_Neutral",)),
    "lookUp": (("lookUp",), ("eyesLookUp",), ("eyeLookUpLeft", "eyeLookUpRight")),
    "lookDown": (("lookDown",), ("eyesLookDown",), ("eyeLookDownLeft", "eyeLookDownRight")),
    "lookLeft": (("lookLeft",), ("eyeLookOutLeft", "eyeLookInRight")),
    "lookRight": (("lookRight",), ("eyeLookInLeft", "eyeLookOutRight")),
}
"""Morph targets that make each of VRM's expressions; those of the first row that a file has. The names are VRM's own,
those of visemes, VRoid Studio and VRM 0, and ARKit's."""

CHANNEL_TARGETS: dict[str, tuple[tuple[str, ...], ...]] = {
    **dict.fromkeys(("voice", "mouth_open"), (*EXPRESSION_TARGETS["aa"], ("mouthOpen",))),
    "mouth_wide": (*EXPRESSION_TARGETS["ee"], ("mouthStretchLeft", "mouthStretchRight")),
    "smile": (("mouthSmile",), ("smile",), *EXPRESSION_TARGETS["happy"]),
    **{f"blink_{side.lower()}": EXPRESSION_TARGETS[f"blink{side}"] + EXPRESSION_TARGETS["blink"] for side in _SIDES},
    "brow_up": (("browInnerUp",), ("Fcl_BRW_Surprised",)),
}
"""Morph targets that each channel moves; those of the first row that a mesh has."""


def morph_tables(names: Sequence[str]) -> list[dict[str, str]]:
    """Return ``target`` and ``channel`` of each ``[[morph]]`` that moves some of a mesh's targets as usual."""
    named = {name.lower(): name for name in names}
    known = {
        channel: next((row for row in choices if all(name.lower() in named for name in row)), ())
        for channel, choices in CHANNEL_TARGETS.items()
    }
    return [{"target": named[name.lower()], "channel": channel} for channel, row in known.items() for name in row]
