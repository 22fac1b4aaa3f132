"""Meshes from one run by several methods, each moved onto the true shape and compared with it."""

import lwrprobe as lp

run = lp.explore("cylinder_vertical", seed=7, settings={"strategy.step": 0.03, "truth.profile": "ideal"})
print(f"{len(run.contacts)} contacts on lines 30 mm apart")
print(f"{'method':18} {'mean mm':>8} {'largest mm':>11} {'volume error':>13}")
for method in ("contact_surface", "convex_hull", "hermite_rbf"):
    mesh = lp.reconstruct(run, method=method)
    error = lp.evaluate(mesh, run.scene, align=True).mesh
    print(f"{method:18} {1e3 * error.mean:8.3f} {1e3 * error.hausdorff:11.3f} {error.volume_error:13.2%}")
