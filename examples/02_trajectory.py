"""A straight motion of the tip whose goal is changed on the way; position and speed are drawn into a picture."""

import numpy as np
from matplotlib.figure import Figure

from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory

CYCLE = 0.001  # s
limits = CartesianLimits(speed=0.2, acceleration=2.0, jerk=40.0, turn_rate=0.5, turn_acceleration=3.0, turn_jerk=50.0)
first, second = np.eye(4), np.eye(4)
first[:3, 3] = 0.10, 0.0, 0.0
second[:3, 3] = 0.06, 0.05, 0.0

trajectory = CartesianTrajectory(CYCLE, limits)
trajectory.reset(np.eye(4))
trajectory.set_goal(first, speed=0.2)
times, places, speeds = [], [], []
while not trajectory.arrived:
    if len(times) == 300:  # after 0.3 s, in full motion
        trajectory.set_goal(second, speed=0.2)
    trajectory.step()
    times.append(len(times) * CYCLE)
    places.append(trajectory.pose[:2, 3].copy())
    speeds.append(np.linalg.norm(trajectory.velocity))

print(f"the second goal was reached after {times[-1]:.3f} s, {len(times)} set points")
print(f"largest speed {max(speeds):.3f} m/s of {limits.speed} m/s allowed")
print(f"distance from the goal {np.linalg.norm(trajectory.pose[:3, 3] - second[:3, 3]):.1e} m")

figure = Figure(figsize=(9, 4), layout="constrained")
path, speed = figure.subplots(1, 2)
path.plot(*(1e3 * np.array(places)).T)
path.set(xlabel="x [mm]", ylabel="y [mm]", title="path of the tip", aspect="equal")
speed.plot(times, speeds)
speed.set(xlabel="time [s]", ylabel="speed [m/s]", title="speed of the tip")
figure.savefig("trajectory.png")
print("wrote trajectory.png")
