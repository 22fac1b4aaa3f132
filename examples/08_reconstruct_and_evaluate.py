"""Meshes from one run by several methods, each compared with the true shape."""

import lwrprobe as lp

run = lp.explore("cylinder_vertical", seed=7, settings={"strategy.step": 0.016})
print(f"{len(run.contacts.points)} contacts on lines 16 mm apart")
print(f"{'method':18} {'mean mm':>8} {'largest mm':>11} {'volume error':>13}")
for method in ("contact_surface", "convex_hull", "concave_hull", "hermite_rbf"):
    run.mesh = lp.reconstruct(run, method=method)
    error = lp.evaluate(run)
    print(f"{method:18} {error.mean:8.3f} {error.hausdorff:11.3f} {error.volume_error:13.2%}")
