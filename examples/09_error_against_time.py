"""The error of the mesh after alignment against the time of the robot: two strategies, two steps."""

from matplotlib.figure import Figure

import lwrprobe as lp

figure = Figure(figsize=(6, 4), layout="constrained")
axes = figure.add_subplot()
for strategy in ("grid_version", "active"):
    times, errors = [], []
    for step in (0.03, 0.015):  # m between two lines, or between a contact and the surface that it stands for
        settings = {"strategy.step": step, "truth.profile": "ideal"}
        run = lp.explore("cylinder_vertical", strategy=strategy, seed=7, settings=settings)
        times.append(run.summary.sim_time_s)
        errors.append(run.summary.mesh_error_aligned_mm["mean"])
        print(f"{strategy:18} step {1e3 * step:.0f} mm: {times[-1]:4.0f} s, mean error {errors[-1]:.3f} mm")
    axes.plot(times, errors, "o-", label=strategy)
axes.set(xlabel="time of the robot [s]", ylabel="mean error of the mesh after alignment [mm]", yscale="log")
axes.legend()
figure.savefig("error_against_time.png")
print("wrote error_against_time.png")
