"""A table that is added to while the tip moves, and read now and then."""

import numpy as np

from lwrprobe_strategies.planning.growing_table import GrowingTable


def test_all_rows_are_there_however_often_they_are_read():
    chance, table = np.random.default_rng(1), GrowingTable(3)
    assert table.last is None
    assert table.rows().shape == (0, 3)
    added = chance.uniform(size=(2000, 3))
    for k, row in enumerate(added.tolist()):
        table.add(tuple(row))
        assert table.last == tuple(row)
        assert len(table) == k + 1
        if chance.random() < 0.02:
            np.testing.assert_array_equal(table.rows(), added[: k + 1])
    early = table.rows()[:10]
    for row in added.tolist():
        table.add(tuple(row))
    np.testing.assert_array_equal(table.rows(), np.concatenate([added, added]))
    np.testing.assert_array_equal(early, added[:10])
