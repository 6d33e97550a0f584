"""Moods of a film's light."""

from engine_bridge.film.scene import DEFAULT_SET, Mood, SetTables
from engine_bridge.film.sets import SETS
from engine_bridge.pictures.surroundings import Lighting

MOODS: dict[Mood, Lighting] = {
    "day": Lighting(),
    "evening": Lighting((1.35, 0.92, 0.58), (0.38, 0.34, 0.44), (0.20, 0.14, 0.10), (-0.62, 0.60, 0.42)),
    "night": Lighting((0.42, 0.56, 0.92), (0.13, 0.18, 0.32), (0.03, 0.05, 0.09), (0.48, 0.74, 0.36)),
    "overcast": Lighting((0.62, 0.64, 0.64), (0.62, 0.68, 0.72), (0.24, 0.25, 0.22), (-0.30, 0.90, 0.32)),
    "spotlight": Lighting((1.55, 1.42, 1.20), (0.20, 0.19, 0.26), (0.10, 0.07, 0.06), (-0.20, 0.86, 0.46)),
    "water": Lighting((0.78, 1.06, 1.10), (0.24, 0.46, 0.56), (0.10, 0.20, 0.20), (-0.24, 0.92, 0.30)),
}
"""Linear RGB irradiances of the key light, the sky and the ground, and the direction towards the key light."""


def lighting_of(scene: SetTables) -> Lighting:
    """Return the light of a scene: that of its mood, by default the set's."""
    return MOODS[scene.light.mood or SETS[scene.background.shown_set or DEFAULT_SET].mood]
