"""Three ways to step one sphere on a stick against a wall: what the simulator's scheme is measured beside.

Along the wall's normal, with the foot of the stick at p(t) and the sphere's penetration y: m y'' = k (p - y) - N and
N = max(0, K y + D y') for y > 0. A run is one row per step of `foot` and gives the contact force at the end of each.
"""

from lwrprobe.compiled import kernel


@kernel
def contact_press(stiffness, damping, depth, rate):
    return max(0.0, stiffness * depth + damping * rate) if depth > 0.0 else 0.0


@kernel
def explicit_steps(mass, stick, stiffness, damping, step, foot, force):
    """Forward Euler: all forces from the start of the step. Returns the number of steps before it blew up."""
    depth, speed = foot[0], 0.0
    for i in range(1, foot.shape[0]):
        push = stick * (foot[i - 1] - depth) - contact_press(stiffness, damping, depth, speed)
        depth, speed = depth + step * speed, speed + step * push / mass
        force[i] = contact_press(stiffness, damping, depth, speed)
        if not abs(force[i]) < 1e9:
            return i
    return foot.shape[0]


@kernel
def semi_implicit_steps(mass, stick, stiffness, damping, step, foot, force):
    """Symplectic Euler: forces from the start of the step, motion with the new speed. Returns as `explicit_steps`."""
    depth, speed = foot[0], 0.0
    for i in range(1, foot.shape[0]):
        speed += step * (stick * (foot[i - 1] - depth) - contact_press(stiffness, damping, depth, speed)) / mass
        depth += step * speed
        force[i] = contact_press(stiffness, damping, depth, speed)
        if not abs(force[i]) < 1e9:
            return i
    return foot.shape[0]


@kernel
def implicit_steps(mass, stick, stiffness, damping, step, foot, force):
    """Backward Euler, in closed form since the law is linear on each branch. Returns as `explicit_steps`."""
    depth, speed = foot[0], 0.0
    rate = damping / step
    for i in range(1, foot.shape[0]):
        inert = mass / (step * step)
        drive = inert * (depth + step * speed) + stick * foot[i]
        end = drive / (inert + stick)
        force[i] = 0.0
        if end > 0.0:
            pressed = (drive + rate * max(depth, 0.0)) / (inert + stick + stiffness + rate)
            press = (stiffness + rate) * pressed - rate * max(depth, 0.0)
            if press > 0.0:
                end, force[i] = pressed, press
        depth, speed = end, (end - depth) / step
    return foot.shape[0]
