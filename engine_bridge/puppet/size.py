"""Size of a character: metres per mesh unit, from the height of its mesh and from what kind of body it is."""

from typing import NamedTuple

from engine_bridge.puppet.body_plans import BodyPlan

METRES_PER_UNIT = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001}
"""Units of mesh files in metres, the most likely first."""


class Heights(NamedTuple):
    """Plausible heights of a kind of body, in metres: the lowest, a typical one and the highest."""

    low: float
    typical: float
    high: float


HEIGHTS: dict[BodyPlan | None, Heights] = {
    "upright": Heights(1.2, 1.7, 2.3),
    "two legs": Heights(0.3, 1.5, 4.0),
    "four legs": Heights(0.15, 0.5, 1.3),
    "many legs": Heights(0.05, 0.3, 1.0),
    "wings": Heights(0.2, 1.5, 3.0),
    "no legs": Heights(0.1, 0.6, 1.5),
    None: Heights(0.2, 1.0, 2.5),
}
"""Heights by the body plan; None stands for a body without limbs. A horse without a unit is as tall as a dog."""


def propose_scale(height: float, plan: BodyPlan | None) -> tuple[float, str]:
    """Return metres per unit of a mesh, and the reason.

    It is the first usual unit in which the body has a plausible height, else the one that gives it a typical height.

    Parameters
    ----------
    height : float
        Mesh units.
    plan : BodyPlan or None
    """
    low, typical, high = HEIGHTS[plan]
    for name, metres in METRES_PER_UNIT.items():
        if low <= height * metres <= high:
            return metres, f"{height:.3g} units tall: {name}"
    scale = float(f"{typical / height:.4g}") if height > 0 else 1.0
    return scale, f"{height:.3g} units tall, which no usual unit explains: {typical:g} m, a typical height"
