"""The mesh follows the object's own field where contacts show that this is better, and nowhere else."""

import numpy as np
import pytest

from lwrprobe.bench.sampled_lines import sample_lines
from lwrprobe.contracts import TouchRecord, TriangleMesh
from lwrprobe.reconstruction import reconstruct
from lwrprobe.reconstruction.hermite_field import HermiteField
from lwrprobe.reconstruction.hermite_rbf import field_data
from lwrprobe.reconstruction.settling import predicted_better, settled
from lwrprobe.reconstruction.touches import prepare
from lwrprobe.scene.shape import Box
from lwrprobe.scene.solid import Solid
from lwrprobe.scene.table import Pose

pytestmark = pytest.mark.slow

SPHERE, PITCH, HALF_LENGTH = 0.005, 0.01, 0.045


def waist(x):
    """m, radius about the x axis of a lying spindle with a waist whose hollow has a radius of 13 mm."""
    return 0.024 * np.sqrt(np.maximum(1.0 - (x / HALF_LENGTH) ** 2, 0.0)) * (1.0 - 0.2 * np.exp(-((x / 0.01) ** 2)))


def spindle():
    """Contacts on lines across the upper half of the spindle, whose axis lies on the table."""
    random, points, normals = np.random.default_rng(1), [], []
    u = np.linspace(-HALF_LENGTH, HALF_LENGTH, 20_001)[1:-1]
    slope = np.gradient(waist(u), u)
    centre = u - SPHERE * slope / np.hypot(1.0, slope)
    for x in np.arange(-HALF_LENGTH, 0.05, PITCH):
        at, lean = np.interp(x, centre, u), np.interp(x, centre, slope)
        angle = np.arange(0.0, np.pi, 0.001 / max(waist(at), 0.003))
        across = np.column_stack([np.cos(angle), np.sin(angle)])
        points.append(np.column_stack([np.full(len(angle), at), waist(at) * across]))
        normals.append(np.column_stack([np.full(len(angle), -lean), across]) / np.hypot(1.0, lean))
    points, normals = np.concatenate(points), np.concatenate(normals)
    touched = points[:, 2] + SPHERE * normals[:, 2] >= SPHERE
    points, normals = points[touched], normals[touched]
    points = points + 2e-5 * random.normal(size=points.shape)
    return TouchRecord(points, normals=normals, probe_radius=SPHERE, table=0.0, lowest=SPHERE, pitch=PITCH)


def overhang():
    """A wide box on a narrow one."""
    foot = Box(shape="box", size=(0.03, 0.03, 0.03), at=Pose(xyz=(0.0, 0.0, 0.015)))
    top = Box(shape="box", size=(0.07, 0.06, 0.02), at=Pose(xyz=(0.0, 0.0, 0.04)))
    return sample_lines(Solid.from_shapes([foot, top]), PITCH, 0.25)


def test_a_smooth_solid_is_as_good_as_on_its_own_field():
    found = reconstruct(spindle())
    assert found.report["method"] == "contact_surface"
    assert found.report["smooth"]
    assert found.report["watertight"]
    middles = found.mesh.vertices[found.mesh.faces].mean(axis=1)
    middles = middles[(middles[:, 2] > SPHERE) & (np.abs(middles[:, 0]) < 0.04)]
    off = np.abs(np.hypot(middles[:, 1], middles[:, 2]) - waist(middles[:, 0]))
    assert off.mean() < 2.5e-5, "it had been 0.033 mm"


def test_edges_keep_the_surface_of_the_centres():
    record = overhang()
    assert not predicted_better(prepare(record, 0.002), PITCH)
    assert not reconstruct(record).report["smooth"]


def test_nothing_moves_below_the_floor_or_far_from_contacts():
    touches = prepare(spindle(), 0.002)
    centres = HermiteField(field_data(touches.centres, touches, PITCH), 2.0 * PITCH)
    corners = np.array([[0.1, 0.0, 0.02], [0.11, 0.0, 0.02], [0.1, 0.01, 0.02]])  # 50 mm beside the spindle
    beside = waist(0.0) * np.array([[0.0, 0.8, 0.6], [0.0, 0.6, 0.8]])
    low = np.array([[0.0, 0.019, 0.0]])
    mesh = TriangleMesh(np.vstack([corners, beside, low]), np.array([[0, 1, 2], [3, 4, 5]]))
    moved = settled(mesh, centres, touches, PITCH, 0.0).vertices
    assert np.array_equal(moved[[0, 1, 2, 5]], mesh.vertices[[0, 1, 2, 5]])
    assert (np.linalg.norm(moved - mesh.vertices, axis=1)[3:5] > 0.0).all()
    assert np.linalg.norm(moved - mesh.vertices, axis=1).max() <= 0.2 * SPHERE + 1e-12


def test_contacts_in_one_block_say_nothing():
    record = spindle()
    few = np.flatnonzero(np.linalg.norm(record.points - record.points[0], axis=1) < 0.003)
    touches = prepare(record, 0.002)
    touches.points, touches.normals, touches.confidence = (
        rows[few] for rows in (touches.points, touches.normals, touches.confidence)
    )
    assert not predicted_better(touches, 1.0)
