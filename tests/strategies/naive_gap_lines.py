"""What lines along y leave out, looked for one place at a time."""

import math


def steep_between(touches, x_a, x_b, y, pitch, floor):
    """Whether the surface between two grid lines is too steep at y: from the highest touches near y on each."""

    def height(x):
        found = [row[2] for row in touches if row[9] == x and abs(row[1] - y) < 0.0015]
        return max(found, default=floor)

    return math.hypot(x_b - x_a, height(x_b) - height(x_a)) > max(x_b - x_a, pitch) + 0.002
