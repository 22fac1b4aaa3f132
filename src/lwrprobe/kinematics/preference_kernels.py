"""Where a redundant arm would rather be: a wish for the joints that the tip does not feel.

A wish is the descent of `potential`: towards a posture, away from limits that are near, away from singularities
(Yoshikawa 1985). It enters the solver as PUSH, of which only the null-space part survives.

A joint that comes near its limit slows down before it, and the others take over: it weighs less the nearer the limit
is, as in the weighted least norm of Chan and Dubey (1995), but in both directions, so that no weight ever jumps.
"""

import math

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import LOWER, UPPER
from lwrprobe.kinematics.dls_kernels import JAC, NORMAL, PUSH, RHS, WEIGHT, factorise, gram, substitute

# columns of the settings row, behind those of dls_kernels
NEAR_POSTURE, OFF_LIMITS, OFF_SINGULARITY, NULL_SPACE_STEP = range(7, 11)
# rows of `places`: the preferred posture, and the ends of the ranges in which no limit is near
POSTURE, EASE_LOW, EASE_HIGH = range(3)
# a joint at its limit keeps this share of its weight: an arm that is not redundant still needs it
LEAST_WEIGHT = 1e-3


@kernel
def ease(chain, places, q, work):
    """WEIGHT of each joint by how far q is from its limits: whole out of the zones beside them, falling smoothly."""
    weight, low, high = work[WEIGHT], places[EASE_LOW], places[EASE_HIGH]
    for i in range(q.shape[0]):
        row = chain[i + 1]
        share = 1.0
        if q[i] < low[i]:
            share = (q[i] - row[LOWER]) / (low[i] - row[LOWER])
        elif q[i] > high[i]:
            share = (row[UPPER] - q[i]) / (row[UPPER] - high[i])
        share = max(share, 0.0)
        weight[i] *= max(share * share * (3.0 - 2.0 * share), LEAST_WEIGHT)


@kernel
def wish(settings, places, q, work):
    """The way down `potential` from q into PUSH; returns its largest component.

    With a wish to leave singularities, JAC has to hold the Jacobian at q; NORMAL and RHS are used.
    """
    n = q.shape[0]
    push, posture, low, high = work[PUSH], places[POSTURE], places[EASE_LOW], places[EASE_HIGH]
    if settings[OFF_SINGULARITY] > 0.0:
        _opening(n, settings[OFF_SINGULARITY], work)
    else:
        for i in range(n):
            push[i] = 0.0
    near, off = settings[NEAR_POSTURE], settings[OFF_LIMITS]
    largest = 0.0
    for i in range(n):
        push[i] += near * (posture[i] - q[i]) + off * (max(low[i] - q[i], 0.0) - max(q[i] - high[i], 0.0))
        largest = max(largest, abs(push[i]))
    return largest


@kernel
def steepness(chain, settings, places, q, work):
    """How many times the PUSH left by `project` passes the place, along itself, where nothing is left of it.

    With e of joint i that is sum(e_i^2 h_i / w_i) / sum(e_i^2 / w_i): h_i is by how much its wish falls for each rad,
    and in the zone beside a limit its weight w_i falls too. Where singularities count their part is left out.
    """
    push, weight = work[PUSH], work[WEIGHT]
    posture, low, high = places[POSTURE], places[EASE_LOW], places[EASE_HIGH]
    near, off = settings[NEAR_POSTURE], settings[OFF_LIMITS]
    steep = whole = 0.0
    for i in range(q.shape[0]):
        row, falls = chain[i + 1], near
        into, zone = low[i] - q[i], low[i] - row[LOWER]
        if q[i] > high[i]:
            into, zone = q[i] - high[i], row[UPPER] - high[i]
        if 0.0 < into < zone:
            share = 1.0 - into / zone
            wanted = near * abs(posture[i] - q[i]) + off * into
            falls += off + wanted * 6.0 * (1.0 - share) / (zone * share * (3.0 - 2.0 * share))
        part = push[i] * push[i] / weight[i]
        steep += part * falls
        whole += part
    return steep / whole if whole > 0.0 else 0.0


@kernel
def potential(settings, places, q, work):
    """What `wish` descends; JAC has to hold the Jacobian at q where singularities count."""
    n = q.shape[0]
    weight, posture, low, high = work[WEIGHT], places[POSTURE], places[EASE_LOW], places[EASE_HIGH]
    near, off = settings[NEAR_POSTURE], settings[OFF_LIMITS]
    value = 0.0
    for i in range(n):
        beside, into = posture[i] - q[i], max(low[i] - q[i], q[i] - high[i], 0.0)
        value += 0.5 * (near * beside * beside + off * into * into) / weight[i]
    if settings[OFF_SINGULARITY] > 0.0:
        value -= settings[OFF_SINGULARITY] * math.log(_volume(n, work))
    return value


@kernel
def _volume(n, work):
    """sqrt(det(J J')) of JAC, prismatic joints counted in lengths of the arm; leaves the factor in NORMAL."""
    m = work[NORMAL : NORMAL + 6]
    gram(work[JAC : JAC + 6], n, work[WEIGHT], m)
    factorise(m)
    product = 1.0
    for r in range(6):
        product *= m[r, r]
    return 1.0 / math.sqrt(product)


@kernel
def _opening(n, gain, work):
    """The way up gain * log(volume) into PUSH: d/dq_k = sum_i dJ_i/dq_k . (J J')^-1 J_i."""
    jac, m, b, push, weight = work[JAC : JAC + 6], work[NORMAL : NORMAL + 6], work[RHS], work[PUSH], work[WEIGHT]
    _volume(n, work)
    for k in range(n):
        push[k] = 0.0
    for i in range(n):
        for r in range(6):
            b[r] = weight[i] * jac[r, i]
        substitute(m, b)
        for k in range(n):
            lead, follow = (k, i) if k <= i else (i, k)
            w0, w1, w2 = jac[3, lead], jac[4, lead], jac[5, lead]
            v0, v1, v2 = jac[0, follow], jac[1, follow], jac[2, follow]
            s = (w1 * v2 - w2 * v1) * b[0] + (w2 * v0 - w0 * v2) * b[1] + (w0 * v1 - w1 * v0) * b[2]
            if k < i:
                u0, u1, u2 = jac[3, i], jac[4, i], jac[5, i]
                s += (w1 * u2 - w2 * u1) * b[3] + (w2 * u0 - w0 * u2) * b[4] + (w0 * u1 - w1 * u0) * b[5]
            push[k] += gain * weight[k] * s
