"""Distances on a grid, beside all pairs and beside scipy's."""

import naive_mapping
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from lwrprobe.mapping.distance_kernels import distances


def found(marked, edge):
    out = np.empty(marked.shape)
    distances(marked, edge, out)
    return out


@given(
    st.tuples(st.integers(1, 7), st.integers(1, 7), st.integers(1, 7)),
    st.floats(0.0, 1.0),
    st.integers(0, 2**32 - 1),
)
def test_distances_are_those_to_the_nearest_of_all(shape, share, seed):
    marked = np.random.default_rng(seed).random(shape) < share
    assert np.array_equal(found(marked, 0.5), naive_mapping.distances(marked, 0.5))


@pytest.mark.parametrize("share", [0.5, 0.99, 0.9999])
def test_a_large_grid_agrees_with_scipy(share):
    marked = np.random.default_rng(2).random((60, 50, 40)) < share
    assert np.array_equal(found(marked, 1.0), ndimage.distance_transform_edt(marked))
