"""MuJoCo as an independent reference for contact: a sphere pressed on a plane and into a slot, then pushed along.

The same sphere hangs on the same springs over the same boxes. MuJoCo's contacts are soft by regularisation and its
friction creeps, so the comparison is of forces in slow motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lwrprobe.bench.gantry import build_world, follow
from lwrprobe.bench.report import BenchReport

STIFFNESS = 2500.0  # N/m, of the stick in all directions
FRICTION = 0.3
DEPTH = 4e-4  # m, the stick's foot is pressed in
SUBSTEPS = 20  # of MuJoCo in one cycle of 1 ms
TOLERANCE = 0.03

_MODEL = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" cone="elliptic" impratio="10" integrator="implicitfast" iterations="200"
          tolerance="1e-14"/>
  <default><geom friction="{friction} 0 0" condim="3" solref="0.0016 1" solimp="0.99 0.99 0.001"/></default>
  <worldbody>
    {walls}
    <body name="tip" pos="0 0 {height}">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom name="ball" type="sphere" size="0.005" mass="0.01"/>
    </body>
  </worldbody>
  <actuator>
    <position joint="x" kp="{stiffness}" kv="10"/>
    <position joint="y" kp="{stiffness}" kv="10"/>
    <position joint="z" kp="{stiffness}" kv="10"/>
  </actuator>
</mujoco>
"""
_BLOCK = '<geom type="box" size="0.05 0.025 0.025" pos="0 0 0.025"/>'
_SLOT = (
    '<geom type="box" size="0.05 0.0105 0.025" pos="0 0.0145 0.025"/>'
    '<geom type="box" size="0.05 0.0105 0.025" pos="0 -0.0145 0.025"/>'
)
_CASES = (
    # name, scene, MuJoCo's walls, height of first touch, distance pushed
    ("on a plane, pushed along", "block", _BLOCK, 0.055, (8e-4, 0.0, 0.0)),
    ("in a slot, pushed along it", "slot_8mm", _SLOT, 0.053, (8e-4, 0.0, 0.0)),
    ("in a slot, pushed against a wall", "slot_8mm", _SLOT, 0.053, (0.0, 3e-4, 0.0)),
)


def compare_with_mujoco(report: BenchReport) -> None:
    """Add table and verdict to the report, or a note where MuJoCo is not installed."""
    try:
        import mujoco
    except ImportError:
        report.notes.append("mujoco is not installed: sphere on plane and in slot are not compared")
        return
    rows = []
    worst = 0.0
    for name, scene, walls, height, push_by in _CASES:
        path = _path(height, np.array(push_by))
        own, theirs = _own(scene, path), _theirs(mujoco, walls, path)
        rest, pushed = slice(140, 151), slice(400, len(path))
        for stage, when in (("pressed", rest), ("pushed", pushed)):
            mine, other = own[when].mean(axis=0), np.median(theirs[when], axis=0)
            off = float(np.linalg.norm(mine - other) / np.linalg.norm(other))
            worst = max(worst, off)
            rows.append([name, stage, _as_text(mine), _as_text(other), 100 * off])
    columns = ["sphere", "stage", "simulator: force x, y, z [N]", "MuJoCo", "apart [%]"]
    report.table(f"MuJoCo {mujoco.__version__} as reference, friction {FRICTION}", columns, rows)
    report.require(f"forces within {100 * TOLERANCE:g} % of MuJoCo's", f"{100 * worst:.2f} %", worst <= TOLERANCE)


def _as_text(force: np.ndarray) -> str:
    return ", ".join(f"{component:.3f}" for component in force + 0.0)


def _path(height: float, push_by: np.ndarray) -> np.ndarray:
    """(n, 3): down within 100 cycles, at rest for 50, pushed for 400, at rest for 50."""
    down = np.zeros((101, 3))
    down[:, 2] = np.linspace(height + 1e-4, height - DEPTH, 101)
    rest = np.repeat(down[-1:], 50, axis=0)
    push = down[-1] + np.linspace(0.0, 1.0, 401)[1:, None] * push_by
    return np.vstack([down, rest, push, np.repeat(push[-1:], 50, axis=0)])


def _own(scene: str, path: np.ndarray) -> np.ndarray:
    material = ["object.0.stiffness=1e7", f"object.0.friction={FRICTION}"]
    stick = [f"probe.stiffness_lateral={STIFFNESS}", f"probe.stiffness_axial={STIFFNESS}"]
    return follow(build_world(material + stick, scene), path)


def _theirs(mujoco: Any, walls: str, path: np.ndarray) -> np.ndarray:
    text = _MODEL.format(step=1e-3 / SUBSTEPS, friction=FRICTION, walls=walls, height=path[0, 2], stiffness=STIFFNESS)
    model = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(model)
    forces = np.zeros((len(path), 3))
    for i, place in enumerate(path):
        state.ctrl[:] = place - path[0]
        mujoco.mj_step(model, state, SUBSTEPS)
        forces[i] = _on_ball(mujoco, model, state)
    return forces


def _on_ball(mujoco: Any, model: Any, state: Any) -> np.ndarray:
    total, wrench = np.zeros(3), np.zeros(6)
    for i in range(state.ncon):
        mujoco.mj_contactForce(model, state, i, wrench)
        second_is_ball = model.geom(state.contact[i].geom2).name == "ball"
        total += (1.0 if second_is_ball else -1.0) * state.contact[i].frame.reshape(3, 3).T @ wrench[:3]
    return total
