"""Run as a script: makes both generators once; prints the wall and CPU seconds that took, imports excluded."""

import time

import numpy as np

from lwrprobe.trajectory import CartesianLimits, CartesianTrajectory, JointTrajectory

if __name__ == "__main__":
    wall, cpu = time.perf_counter(), time.process_time()
    CartesianTrajectory(1e-3, CartesianLimits(0.25, 2.0, 40.0, 1.0, 5.0, 100.0))
    JointTrajectory(1e-3, -np.ones(7), np.ones(7), np.ones(7), np.ones(7), np.ones(7))
    print(time.perf_counter() - wall, time.process_time() - cpu)
