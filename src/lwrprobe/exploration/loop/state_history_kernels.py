"""The arm's last states in a ring, and the tip between two of them.

A row is time, the tip's velocity (3), the arm's joint values (n), and those of its links (n); row `count - 1` modulo
the ring's length is the newest.
"""

from lwrprobe.compiled import allocation_free_kernel as kernel
from lwrprobe.kinematics.chain_kernels import tip_frame

TIME, VELOCITY, JOINTS = 0, 1, 4


@kernel
def note(ring, count, time, velocity, q, links):
    """Write state number `count`: the arm's joint values q (n,) and those of its links (n,)."""
    row = ring[count % ring.shape[0]]
    row[TIME] = time
    for i in range(3):
        row[VELOCITY + i] = velocity[i]
    for i in range(q.shape[0]):
        row[JOINTS + i] = q[i]
        row[JOINTS + q.shape[0] + i] = links[i]


@kernel
def note_rows(ring, count, times, velocities, joints, links):
    """Write states number `count` and following: times (m,), velocities (m, 3), joint values and links (m, n)."""
    for k in range(times.shape[0]):
        note(ring, count + k, times[k], velocities[k], joints[k], links[k])


@kernel
def joints_at(ring, count, time, first, q):
    """Values q (n,) from column `first` on at an instant, interpolated linearly; returns the row of
    the cycle that the instant lies in.

    Before the oldest state known that one counts, after the newest the newest.
    """
    length = ring.shape[0]
    newest = count - 1
    oldest = max(0, count - length)
    at = newest
    while at > oldest and ring[at % length, TIME] > time:
        at -= 1
    earlier, later = ring[at % length], ring[min(at + 1, newest) % length]
    span = later[TIME] - earlier[TIME]
    share = min(max((time - earlier[TIME]) / span, 0.0), 1.0) if span > 0.0 else 1.0
    for i in range(q.shape[0]):
        q[i] = earlier[first + i] + share * (later[first + i] - earlier[first + i])
    return at % length


@kernel
def tip_at(ring, count, time, chain, q, pose, velocity):
    """Tip pose (4, 4) and joints q (n,) of the links at an instant, and the velocity (3,) commanded in that cycle."""
    row = ring[joints_at(ring, count, time, JOINTS + q.shape[0], q)]
    for i in range(3):
        velocity[i] = row[VELOCITY + i]
    f = tip_frame(chain, q)
    for i in range(3):
        for k in range(4):
            pose[i, k] = f[3 * k + i]
        pose[3, i] = 0.0
    pose[3, 3] = 1.0


@kernel
def mean_velocity(ring, count, time, span, chain, q, velocity):
    """Mean velocity (3,) of the tip as measured over `span` s after an instant, or over the last `span` s known.

    q (n,) is overwritten; zero before there are states over a tenth of the span.
    """
    length = ring.shape[0]
    newest, oldest = ring[(count - 1) % length, TIME], ring[max(0, count - length) % length, TIME]
    end = min(time + span, newest)
    begin = max(end - span, oldest)
    for i in range(3):
        velocity[i] = 0.0
    if not end - begin > 0.1 * span:
        return
    for instant, sign in ((begin, -1.0), (end, 1.0)):
        joints_at(ring, count, instant, JOINTS, q)
        f = tip_frame(chain, q)
        for i in range(3):
            velocity[i] += sign * f[9 + i]
    for i in range(3):
        velocity[i] /= end - begin


@kernel
def acceleration(ring, count):
    """m/s^2 of the tip over the last cycle, infinite without two earlier states."""
    length = ring.shape[0]
    if count < 2:
        return float("inf")
    new, old = ring[(count - 1) % length], ring[(count - 2) % length]
    span = new[TIME] - old[TIME]
    total = 0.0
    for i in range(VELOCITY, VELOCITY + 3):
        total += (new[i] - old[i]) ** 2
    return total**0.5 / span if span > 0.0 else float("inf")
