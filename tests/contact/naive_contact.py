"""Textbook forms of the contact kernels, and a generator of true contact wrenches."""

from __future__ import annotations

import numpy as np

from lwrprobe.contact import Wrench
from lwrprobe.contracts import Probe, SampleStatus


def cross_matrix(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def unit(v):
    return np.asarray(v, dtype=float) / np.linalg.norm(v)


def random_rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, [1, 0, 2]]


def angle(a, b):
    """Degrees between two directions."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def lever(probe: Probe, force):
    """The sphere's centre in the sensor frame, with the stick bent by the force."""
    return np.array([0.0, 0.0, probe.sensor_distance]) + probe.compliance * force


def contact_wrench(probe: Probe, rotation, contacts, time=0.0, rng=None, counts=1.0) -> Wrench:
    """Wrench of several contacts (normal, force), both in the world; with a generator, noise and quantisation."""
    force = sum(rotation.T @ f for _, f in contacts)
    centre = lever(probe, force)
    torque = sum(np.cross(centre - probe.radius * (rotation.T @ n), rotation.T @ f) for n, f in contacts)
    values = np.concatenate([force, torque])
    if rng is not None:
        step = np.repeat([probe.force_resolution, probe.torque_resolution], 3)
        values = np.round(values / step + counts * rng.normal(size=6)) * step
    return Wrench(time, values[:3].copy(), values[3:].copy(), rotation @ values[:3])


def axis_normal(probe: Probe, wrench: Wrench):
    """Outward normal in the sensor frame: first point where the line of action enters the sphere, walking along it."""
    f, c = wrench.force, lever(probe, wrench.force)
    torque = wrench.torque - np.cross(c, f)
    foot = np.cross(f, torque) / (f @ f)  # nearest point of the line to the centre
    along = np.sqrt(probe.radius**2 - foot @ foot)
    return -(foot - along * unit(f)) / probe.radius


def condition(params, stream):
    """`conditioning_kernels.condition` in plain words, for a whole stream; yields (status, wrench (6,), counts)."""
    bias, payload, jump = params["bias"], params["weight"], params["jump"]
    counts = dict.fromkeys(("invalid", "saturated", "lost", "late", "frozen", "spikes", "reordered"), 0)
    last = good = suspect = held = None
    for time, sequence, status, raw in stream:
        if status & SampleStatus.LATE:
            counts["late"] += 1
        if not np.isfinite(raw).all() or (np.abs(raw) > params["huge"]).any() or status & SampleStatus.INVALID:
            counts["invalid"] += 1
            status |= SampleStatus.INVALID
        if last is not None and (sequence == last[1] or time == last[0]):
            counts["frozen"] += 1
            status |= SampleStatus.FROZEN
        elif last is not None and (sequence < last[1] or time < last[0]):
            counts["reordered"] += 1
            status |= SampleStatus.LATE
        else:
            if last is not None and sequence > last[1] + 1:
                counts["lost"] += sequence - last[1] - 1
                status |= SampleStatus.LOST_BEFORE
            last = (time, sequence)
        if not status & (SampleStatus.INVALID | SampleStatus.FROZEN | SampleStatus.LATE):
            if (np.abs(raw) >= params["range"]).any():
                counts["saturated"] += 1
                status |= SampleStatus.SATURATED
            wrench = raw - bias - payload
            spike = False
            if good is not None:
                far = [np.linalg.norm((wrench - good)[k]) > jump[i] for i, k in enumerate((slice(0, 3), slice(3, 6)))]
                same = suspect is not None and any(
                    far[i] and (wrench - good)[k] @ (suspect - good)[k] > 0
                    for i, k in enumerate((slice(0, 3), slice(3, 6)))
                )
                spike = any(far) and not same
                counts["spikes"] += suspect is not None and not same
            suspect = wrench if spike else None
            if spike:
                status |= 1 << 16
            else:
                good = wrench
                held = wrench
        else:
            wrench = held if held is not None else np.zeros(6)
        yield int(status), wrench, dict(counts)
