"""The contact point that three estimators find while the sphere slides on a plane with friction."""

import numpy as np

from lwrprobe.contact import ESTIMATORS, Wrench, WrenchNoise, make_estimator
from lwrprobe.scene import load_scene

FRICTION, SPEED, SAMPLES = 0.3, 0.02, 100  # of the plane; m/s along x; number of wrench samples
probe = load_scene("block").probe.as_probe()
lever = np.array([0.0, 0.0, probe.sensor_distance])  # from the sensor to the sphere's centre, sensor frame
sensor = np.diag([1.0, -1.0, -1.0])  # the sensor frame in the world: the probe points down
noise = WrenchNoise.of(probe)
random = np.random.default_rng(0)

normal, velocity = np.array([0.0, 0.0, 1.0]), np.array([SPEED, 0.0, 0.0])
force = normal - FRICTION * velocity / SPEED  # friction acts on the sphere, against the motion
force /= np.linalg.norm(force)  # 1 N

for name in ESTIMATORS:
    estimator = make_estimator(name, probe)
    errors = []
    for sequence in range(SAMPLES):
        centre = np.array([0.008 * sequence * SPEED, 0.0, 0.05])
        point = centre - probe.radius * normal
        in_sensor = sensor.T @ force + random.normal(0.0, noise.force)
        arm = lever + probe.compliance * (sensor.T @ force) + sensor.T @ (point - centre)  # the stick bends
        torque = np.cross(arm, sensor.T @ force) + random.normal(0.0, noise.torque)
        wrench = Wrench(0.008 * sequence, in_sensor, torque, sensor @ in_sensor, sequence)
        contact = estimator.estimate(wrench, centre, sensor, velocity)
        errors.append(1e3 * np.linalg.norm(contact.point - point))
    print(f"{name:16} median error of the contact point {np.median(errors):.3f} mm")
expected = 1e3 * probe.radius * np.sin(np.arctan(FRICTION))
print(f"an estimator that ignores friction is wrong by r sin(atan(mu)) = {expected:.3f} mm")
