"""Records of what a probe touches that does not come down all the way."""

from dataclasses import replace

import numpy as np

from lwrprobe.bench.sampled_lines import RADIUS


def upper_part(record, height):
    """Of a record what a probe touches whose body cannot come lower than `height` m."""
    kept = record.points[:, 2] + RADIUS * record.normals[:, 2] > height
    return replace(
        record,
        points=record.points[kept],
        normals=record.normals[kept],
        free_path=np.maximum(record.free_path, [-np.inf, -np.inf, height]),
    )
