"""One exploration of a simulated cylinder: contacts, map, mesh and how good they are."""

import lwrprobe as lp

run = lp.explore("cylinder_vertical", seed=7, settings={"strategy.step": 0.03}, out="runs/cylinder")
summary = run.summary
print(summary.status, "because", summary.reason)
print(len(run.contacts.points), "contacts in", summary.voxels, "voxels,", f"{summary.sim_time_s:.0f} s of robot time")
print(f"largest force {summary.peak_force_n:.2f} N")
print(f"coverage {summary.coverage:.1%} of the surface that the sphere can reach")
print(f"median error of the contacts {summary.contact_error_aligned_mm['median']:.3f} mm after alignment")
print(f"mean error of the mesh {summary.mesh_error_aligned_mm['mean']:.3f} mm after alignment")
print("closed:", run.mesh.is_watertight)
run.plot().savefig("cylinder.png")
print("wrote cylinder.png; the run is in", run.folder)
