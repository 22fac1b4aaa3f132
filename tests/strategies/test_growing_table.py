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


def test_the_last_row_is_replaced_whether_it_was_read_or_not():
    table = GrowingTable(2)
    table.add((1.0, 2.0))
    table.add((3.0, 4.0))
    table.replace_last((5.0, 6.0))
    np.testing.assert_array_equal(table.rows(), [[1.0, 2.0], [5.0, 6.0]])
    table.replace_last((7.0, 8.0))
    assert table.last == (7.0, 8.0)
    np.testing.assert_array_equal(table.rows(), [[1.0, 2.0], [7.0, 8.0]])
