"""`lwrprobe bench`: error against run time, side by side with the peers that are installed.

One module a bench, each with `run(quick: bool, options: dict[str, str]) -> BenchReport`; `BENCHES` names them
without importing them.
"""

BENCHES: dict[str, str] = {
    "kinematics": "lwrprobe.bench.kinematics",
    "trajectory": "lwrprobe.bench.trajectory",
    "clearance": "lwrprobe.bench.clearance",
    "mapping": "lwrprobe.bench.mapping",
    "contact": "lwrprobe.bench.contact",
    "exploration": "lwrprobe.bench.exploration",
    "planning": "lwrprobe.bench.planning",
    "certificate": "lwrprobe.bench.certificate",
    "physics": "lwrprobe.bench.physics",
    "reality": "lwrprobe.bench.reality",
    "budget": "lwrprobe.bench.budget",
    "calibration": "lwrprobe.bench.calibration",
    "shapes": "lwrprobe.bench.shapes",
    "loop": "lwrprobe.bench.loop",
    "faults": "lwrprobe.bench.faults",
    "stalls": "lwrprobe.bench.stalls",
    "kills": "lwrprobe.bench.kills",
    "endurance": "lwrprobe.bench.endurance",
    "simulation": "lwrprobe.bench.simulation",
    "stability": "lwrprobe.bench.stability",
    "start": "lwrprobe.bench.start",
    "reconstruction": "lwrprobe.bench.reconstruction",
}
