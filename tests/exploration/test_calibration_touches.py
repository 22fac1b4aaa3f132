"""How a calibration cuts what the devices sent into touches, also where the run was interrupted."""

import numpy as np
import pytest

from lwrprobe.contracts import WrenchSample
from lwrprobe.exploration.procedures.calibrate import _spans, _touches
from lwrprobe.exploration.recording.device_log import DeviceLog
from lwrprobe.scene import load_scene
from lwrprobe.scene.scene_robot import robot_of

PERIOD, ZERO, PAUSE, TOUCHES = 0.008, 3.0, 2.5, 3
SKILLS = (("rest", 0.4), ("load", 0.4), ("unload", 0.4), ("transit", 0.4))


def cut(paused_at):
    """Touches of 0.8 s, one every 1.6 s of the run's time, which stood still for 2.5 s of the clock at `paused_at`."""

    def zero(run):
        return ZERO + PAUSE * (run > paused_at)

    def clock(run):
        return zero(run) + run

    trace, now = [(0.0, "program", "calls", "rest")], 0.0
    for name, length in SKILLS * TOUCHES:
        now = round(now + length, 3)
        trace.append((now, name, "ended", ""))
    observed = np.round(np.arange(0.0, now + PERIOD, PERIOD), 3)
    zeros = [(run, zero(run)) for run in observed]
    log = DeviceLog()
    times = np.arange(0.0, clock(now) + 1.0, 1e-3)
    joints = np.tile(np.linspace(0.1, 0.7, 7), (len(times), 1))
    log.note(times, joints, joints)
    for k, run in enumerate(observed):
        phase = run % 1.6
        force = 2.0 * np.interp(phase, (0.4, 0.8, 1.2), (0.0, 1.0, 0.0))
        log.samples.append((clock(run), WrenchSample(clock(run), np.array([0.0, 0.0, force]), np.zeros(3), k)))
    robot = robot_of(load_scene("block"))
    found = _touches(log, _spans(trace, zeros), robot, np.zeros((1, 3)), 0.02)
    return [clock(0.4 + 1.6 * k) for k in range(TOUCHES)], found.touches


@pytest.mark.parametrize("paused_at", [-1.0, 1.55, 2.1])
def test_a_pause_between_two_touches_shifts_those_after_it(paused_at):
    begins, touches = cut(paused_at)
    assert len(touches) == TOUCHES - (paused_at == 2.1)  # a press that was interrupted shows nothing
    for touch in touches:
        begin = min(begins, key=lambda begin: abs(begin - touch.times[0]))
        assert begin < touch.times[0] < touch.times[-1] < begin + 0.8
        turn = touch.times[np.argmax(touch.wrenches[:, 2])]
        assert abs(turn - begin - 0.4) < 0.03
        assert (touch.times[touch.rising] <= begin + 0.4 + 1e-6).all()
        assert (touch.times[~touch.rising] > begin + 0.4 - 1e-6).all()
