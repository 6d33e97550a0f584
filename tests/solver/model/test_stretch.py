import numpy as np
import pytest

from solver.model.stretch import BIN_WIDTH, MAX_STRETCH, EdgeStretch

from ..shapes import stretches


def test_percentiles_are_those_of_all_edges_in_all_frames(creature):
    rng = np.random.default_rng(0)
    frames = [creature.vertices * rng.uniform(0.7, 1.3, 3) + 0.2 * np.sin(2 * creature.vertices) for _ in range(8)]
    measure = EdgeStretch(creature)
    for some in (frames[:3], frames[3:]):
        measure.add(np.stack(some, axis=2).astype(np.float32))
    everything = np.concatenate([stretches(creature, frame) for frame in frames])
    shares = (1, 5, 50, 95, 99, 100)
    found = measure.percentiles(*shares)
    # The nearest rank below or above: one of the two edges around, to half a bin and float32.
    for share, value in zip(shares, found, strict=True):
        low = np.percentile(everything, share, method="lower") - BIN_WIDTH
        high = np.percentile(everything, share, method="higher") + BIN_WIDTH
        assert low <= value <= min(high, MAX_STRETCH)


@pytest.mark.parametrize(
    ("scale", "offset", "stretch"), [(1, 0, 1), (2.5, 7, 2.5), *((s, 0, MAX_STRETCH) for s in (9, np.inf, np.nan))]
)
def test_a_scaled_mesh_is_stretched_by_its_scale_up_to_the_last_bin(creature, scale, offset, stretch):
    measure = EdgeStretch(creature)
    measure.add((scale * creature.vertices + offset).astype(np.float32)[:, :, None])
    assert measure.percentiles(1, 50, 99, 100) == pytest.approx((stretch,) * 4, abs=BIN_WIDTH)
