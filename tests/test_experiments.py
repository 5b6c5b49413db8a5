import numpy as np
import pytest

from alssnn.experiments import split_experiments, stretch


def test_split_experiments():
    assert split_experiments(4, None) == ([slice(0, 4)], [None])
    parts, labels = split_experiments(5, ["b", "b", "a", "a", "a"])
    assert parts == [slice(0, 2), slice(2, 5)]
    assert labels == ["b", "a"]


def test_split_experiments_errors():
    with pytest.raises(ValueError, match=r"one label per sample, shape \(4,\), got"):
        split_experiments(4, [1, 1, 2])
    with pytest.raises(ValueError, match=r"contiguous samples.*label of its own"):
        split_experiments(4, [1, 1, 2, 1])
    for labels in ([0.1, 0.2, 0.1], [0, 1, 2], ["a", "b", "c"]):
        with pytest.raises(ValueError, match=r"every sample.*single run is None"):
            split_experiments(3, labels)
    assert split_experiments(2, [0, 1]) == ([slice(0, 1), slice(1, 2)], [0, 1])


def test_stretch_takes_the_liveliest_part(rng):
    u = rng.standard_normal((1000, 1))
    u[:600] *= 0.01  # the record begins quietly
    y = u.copy()
    ((part_u, part_y),) = stretch([(u, y)], 300)
    assert part_u.shape == part_y.shape == (300, 1)
    assert np.shares_memory(part_u, u)
    assert part_u.std() > 0.9 * u[600:].std()


def test_stretch_shares_the_samples_among_experiments(rng):
    records = [(rng.standard_normal((n, 1)),) * 2 for n in (100, 300)]
    assert [len(u) for u, _ in stretch(records, 40)] == [10, 30]
    assert stretch(records, 400) == records
