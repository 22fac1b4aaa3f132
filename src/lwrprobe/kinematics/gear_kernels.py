"""From motor positions to joint values behind the gears."""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def links(motors, waves, sine, cosine, half, played, out):
    """Joint values out (m, n) of motor positions (m, n), oldest first.

    waves : rad of a gear's wave to one of the joint; sine, cosine : (n,) rad of the wave; half : rad, half of the play;
    played : (n,) rad behind the play, the state.
    """
    for k in range(motors.shape[0]):
        for i in range(motors.shape[1]):
            q = motors[k, i]
            played[i] = min(max(played[i], q - half), q + half)
            out[k, i] = played[i] + sine[i] * math.sin(waves * q) + cosine[i] * math.cos(waves * q)
