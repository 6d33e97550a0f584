"""What a body is, in words that a person can compare with a picture of it."""

from collections import Counter
from collections.abc import Iterable

from engine_bridge.puppet.body_plans import BodyPlan

KINDS: dict[BodyPlan | None, str] = {
    "upright": "a person",
    "two legs": "a body on two legs",
    "four legs": "an animal on four legs",
    "many legs": "an animal on many legs",
    "wings": "a body with wings and legs",
    "no legs": "a body without legs",
    None: "a shape without limbs",
}

COUNTED = ("head", "neck", "arm", "wing", "leg", "tail", "ear")
"""Limbs that are counted, in the order in which they are listed."""

NUMBERS = ("", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def body_summary(plan: BodyPlan | None, limbs: Iterable[str]) -> str:
    """Return a body plan and the numbers of limbs in words: "a person: one head, two arms, two legs".

    Parameters
    ----------
    plan : BodyPlan or None
        None for a puppet without limbs.
    limbs : iterable of str
        Their names.
    """
    counts = Counter(word for name in limbs for word in name.split() if word in COUNTED)
    words = [
        f"{NUMBERS[count] if count < len(NUMBERS) else count} {limb}{'' if count == 1 else 's'}"
        for limb in COUNTED
        if (count := counts[limb])
    ]
    return f"{KINDS[plan]}: {', '.join(words)}" if words else KINDS[plan]
