"""The first start on several cores: a second process compiles what a run needs late, this one what it needs first.

The second process makes the simulated world, and from made-up contacts with the scene's object the mesh, the summary,
the pictures and the report, as a run does at its end. All that it leaves behind is in the cache on disk, where the run
finds it. Whatever goes wrong there, the run compiles itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import weakref
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from lwrprobe.compiled.disk_cache import is_stored
from lwrprobe.compiled.pipeline import collector_paused
from lwrprobe.contact import Counters
from lwrprobe.contracts import Contact, Observation, StorageError
from lwrprobe.evaluation import reach
from lwrprobe.evaluation.render_kernels import paint
from lwrprobe.evaluation.run_report import write_report
from lwrprobe.exploration.loop.devices import Devices
from lwrprobe.exploration.loop.explorer import Outcome
from lwrprobe.exploration.recording.certification import certify
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.results import touch_record, write_results
from lwrprobe.exploration.recording.summary import DEFAULT_SPACING, summarise
from lwrprobe.exploration.stages.pipeline import named_reconstructor
from lwrprobe.host.cores import cores
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import Scene, load_scene, write_scene
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.solid_kernels import nearest_batch
from lwrprobe.scene.table import Pose

NOMINAL_CYCLE = 0.001
"""s, for a pipeline that is made before the arm is known, to be compiled alone."""
PATIENCE = 30.0
"""s that a run waits at its end for the second process, rather than compile the same a second time."""
_CONTACTS = 600


class CompileAhead:
    """The second process of a run; it ends when it is done, when `close` is called, or with the run's own process."""

    def __init__(self, scene: Scene) -> None:
        """Raises OSError where no process can be started, StorageError where its scene cannot be written."""
        folder = tempfile.TemporaryDirectory(prefix="lwrprobe-", ignore_cleanup_errors=True)
        try:
            write_scene(scene, Path(folder.name, "scene.toml"))
            # Not multiprocessing: that would run a script without a `__main__` guard a second time.
            self.process = subprocess.Popen(
                [sys.executable, "-m", __name__, folder.name],
                stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        except BaseException:
            folder.cleanup()
            raise
        self.close = weakref.finalize(self, _end, self.process, folder)
        """End the process and remove its files; may be called more than once."""

    @classmethod
    def where_it_pays(cls, scene: Scene) -> CompileAhead | None:
        """A second process where kernels are missing on the disk and there is a core for it; None otherwise.

        None as well where no process can be started, and while numba is switched off.
        """
        if not sys.executable or cores() < 2:
            return None
        if is_stored(nearest_batch) and is_stored(paint):  # the first and the last that it compiles
            return None
        with suppress(OSError, StorageError):
            return cls(scene)
        return None

    @property
    def running(self) -> bool:
        """It still compiles."""
        return self.process.poll() is None

    def wait(self, seconds: float = PATIENCE) -> None:
        """Wait until the process has ended, for so many seconds at most, and end it."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)
        self.close()


def _end(process: subprocess.Popen[bytes], folder: tempfile.TemporaryDirectory[str]) -> None:
    process.kill()  # an entry of the cache is put in place whole, and its lock goes with the process
    if process.stdin is not None:
        process.stdin.close()
    process.wait()
    folder.cleanup()


def compile_late_kernels(scene: Scene, folder: Path) -> None:
    """Do with made-up contacts what a run of `scene` does at its end; the files go into `folder`.

    Of the devices the simulator alone is made. Raises what the parts raise for a scene that cannot be run.
    """
    simulated = scene.arm.driver == scene.sensor.driver == "sim"
    truth = Devices.assemble(scene, scene.run.seed, False).ground_truth if simulated else None
    make, options = named_reconstructor(scene)
    recorder, voxels = Recorder(folder), VoxelMap(scene.map.resolution)
    recorder.open()
    try:
        _make_contacts(scene, recorder, voxels)
    finally:
        recorder.close()
    surface = make(options).reconstruct(touch_record(recorder, scene, voxels, DEFAULT_SPACING))
    # The stages that only a moving arm needs are compiled by the run itself at this time.
    pipeline: Any = SimpleNamespace(
        voxels=voxels, surface=voxels, clearance=None, object_motion=None, probe=scene.probe.as_probe(),
        area=scene.area.as_area(), explored=scene.area.as_area(), bounds=None, raised=0.0,
        touching_poses=lambda centre, facing: (),
        force=SimpleNamespace(report=dict, planned=None), torque=None, noise_at_rest=None, left_out=[],
        line_spacing=DEFAULT_SPACING,
    )  # fmt: skip
    certified = certify(recorder, pipeline.area, pipeline.probe, pipeline.line_spacing, _OUTCOME.time)
    summary = summarise(scene, pipeline, truth, recorder, _OUTCOME, surface, 1.0, certified=certified)
    write_results(folder, scene, pipeline, recorder, surface, summary)
    summary.write(folder / "summary.json")
    write_report(folder, surface)


def _make_contacts(scene: Scene, recorder: Recorder, voxels: VoxelMap) -> None:
    """Contacts spread over the object, or over a box in the middle of the area, and a free path above them."""
    lower, upper = np.array(scene.area.lower), np.array(scene.area.upper)
    middle = 0.5 * (lower + upper)
    stand_in = Box(shape="box", size=(0.06, 0.04, 0.04), at=Pose(xyz=(middle[0], middle[1], middle[2])))
    solid = scene.solid() if scene.objects else Solid.from_shapes([stand_in])
    radius = scene.probe.radius
    found = reach(solid, radius, float(lower[2]), scene.area.as_area(), _CONTACTS)
    for k, (point, normal) in enumerate(zip(found.points, found.normals)):
        recorder.contact(Contact(0.1 * k, point, normal, normal, point + radius * normal), k)
        voxels.insert_point(point)
    for k, x in enumerate(np.linspace(lower[0], upper[0], 60)):
        pose = np.eye(4)
        pose[:3, 3] = x, middle[1], upper[2]
        recorder.trace_row(0.1 * k, pose[:3, 3], 0.0, False, np.inf, "free", 0.0)
        recorder.swept.note(Observation(0.1 * k, pose, np.zeros(3), np.zeros(3)))


_OUTCOME = Outcome(
    status="done", reason="contacts were made up", time=1.0, touches=_CONTACTS, path=1.0, contact_path=1.0,
    peak_force=1.0, peak_bound=1.0, late_by=0.0, interruptions=[], gaps=0, range_used=0.1, cycle_us=1.0,
    guard_interventions=0, slowed_cycles=0, stages=[],
    counters=Counters(*[0] * len(Counters.__dataclass_fields__)),
)  # fmt: skip


def _end_with_the_run() -> None:
    """The pipe from the run's process closes when that ends, however it ends."""
    os.read(0, 1)  # not sys.stdin: its lock would be held when this process ends
    os._exit(0)


def main(folder: Path) -> None:
    """What the second process does."""
    threading.Thread(target=_end_with_the_run, daemon=True).start()
    scene = load_scene(str(folder / "scene.toml"))
    if scene.arm.driver != "sim" and hasattr(os, "nice"):
        os.nice(10)  # the loop of a real arm goes first
    with collector_paused():
        compile_late_kernels(scene, folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
