"""What was recorded after the object has moved: on disk it stays, what follows the run does without it."""

import numpy as np

from lwrprobe.contracts import Observation
from lwrprobe.exploration.recording.certification import Certification
from lwrprobe.exploration.recording.recorder import Recorder
from lwrprobe.exploration.recording.results import touch_record
from lwrprobe.mapping import VoxelMap
from lwrprobe.scene import load_scene

SCENE = load_scene("block")


def recorded(seconds, withheld=None):
    """A free path over the scene's area, 1 mm every 0.1 s on lines 8 mm apart, of so many seconds."""
    recorder, area = Recorder(None), SCENE.area.as_area()
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    for k in range(round(10 * seconds)):
        line, at = divmod(k, 100)
        pose[:3, 3] = 0.5 * (area.lower + area.upper)
        pose[:2, 3] = area.lower[:2] + np.array([0.008 * line + 0.005, 0.001 * at])
        recorder.trace_row(0.1 * k, pose[:3, 3], 0.0, False, 1.0, "transit", 0.0)
        recorder.swept.note(Observation(0.1 * k, pose.copy(), np.zeros(3), np.zeros(3)))
    if withheld is not None:
        recorder.withhold(withheld)
    return recorder


def test_the_free_path_after_it_says_nothing_of_the_surface():
    record = touch_record(recorded(80.0, withheld=49.95), SCENE, VoxelMap(0.002), 0.01)
    np.testing.assert_array_equal(record.free_path, recorded(50.0).trace()[:, 1:4])


def test_it_certifies_no_more_than_the_run_up_to_there():
    def unknown(recorder):
        return Certification(recorder, SCENE.area.as_area(), SCENE.probe.as_probe(), 0.01).at().unknown

    assert unknown(recorded(80.0, withheld=49.95)) == unknown(recorded(50.0)) > unknown(recorded(80.0))
