"""Sets: a panorama whose ends fit together, and whose ground has the colour of the floor."""

import numpy as np
import pytest

from engine_bridge.film import painting
from engine_bridge.film.painting import BOTTOM, PIXELS_PER_DEGREE
from engine_bridge.film.sets import SETS, panorama


@pytest.fixture(autouse=True)
def _coarse(monkeypatch):
    """Paint no finer than the result is, in a quarter of the time."""
    monkeypatch.setattr(painting, "SUPERSAMPLING", 1)


@pytest.mark.parametrize("name", SETS)
def test_the_ground_of_a_set_is_its_floor_and_both_repeat_without_a_seam(name):
    around, floor = panorama(name), SETS[name].floor()
    ground = around[round(BOTTOM * PIXELS_PER_DEGREE / 2) :, :, :3]  # the lower half of what is below the horizon
    assert np.abs(np.median(ground, axis=(0, 1)) - floor[..., :3].mean(axis=(0, 1))).max() < 4
    for picture in (around, floor):
        steps = np.abs(np.diff(picture[..., :3].astype(int), axis=1)).mean(axis=(0, 2))
        seam = np.abs(picture[:, 0, :3].astype(int) - picture[:, -1, :3]).mean()
        assert seam <= steps.max() + 2


def test_a_set_always_looks_the_same():
    assert (panorama("city") == panorama("city")).all()
