"""Pages and films of runs; the page in a real browser, where one is installed."""

import os
import shutil
import subprocess
import threading
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import lwrprobe as lp
from lwrprobe.contracts import FormatError, InputError, TriangleMesh
from lwrprobe.evaluation.comparison import _from_mesh, write_comparison
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.reconstruction.meshes import write_mesh
from lwrprobe.views.film import _write_video, write_film
from lwrprobe.views.playback import body, of_scene, playback, posed
from lwrprobe.views.viewer import Viewer

pytestmark = pytest.mark.slow

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def runs(recorded_cylinder, made_once, upper_edge) -> list[Path]:
    """A run with a bag, and one without."""

    def explore(folder):
        lp.explore(
            "cylinder_vertical", strategy="surface_contour", seed=5, settings=upper_edge, out=folder, progress=False
        )

    return [recorded_cylinder, made_once("cylinder_without_bag", explore)]


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


def picture(browser, url: str, path: Path, shows, ready=lambda page: None) -> np.ndarray:
    """What the page shows once it draws what it should and stands still, with nothing asked of other hosts."""
    page = browser.new_page(viewport={"width": 1000, "height": 640})
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(url)
    page.get_by_text("points by").wait_for(timeout=120_000)
    page.wait_for_function("document.querySelector('canvas') !== null", timeout=60_000)
    ready(page)
    image, before, end = None, None, time.monotonic() + 120.0
    while before is None or (image != before).any() or not shows(image):
        assert time.monotonic() < end, "what the page should show is not there, or never stands still"
        page.wait_for_timeout(1_000)
        page.screenshot(path=path)
        before, image = image, np.asarray(Image.open(path).convert("RGB")).astype(int)
    page.close()
    away = [url for url in asked if "127.0.0.1" not in url and not url.startswith(("data:", "blob:"))]
    assert away == []
    return image


def share(image: np.ndarray, colour: tuple[int, int, int], within: int = 60) -> float:
    """Of the pixels left of the controls, those near a colour."""
    seen = image[:, :700]
    return float((np.abs(seen - np.array(colour)).sum(axis=2) < within).mean())


def test_the_arm_stands_where_the_bag_has_it(runs):
    shown = playback(runs[0])
    assert len(shown.times) > 100
    assert shown.joints.shape == (len(shown.times), 7)
    for k in (0, len(shown.times) // 2, -1):
        assert shown.tips[k] == pytest.approx(shown.robot.fk(shown.joints[k]).A, abs=1e-9)
    assert len(shown.goals) > 3
    assert len(shown.states) > 10
    assert len(shown.clearances) > 10
    contacts = lp.open_run(runs[0]).contacts
    assert shown.points == pytest.approx(contacts.points)
    alone = playback(runs[0] / "bag" / "bag_0.mcap")
    measured = read_run(runs[0], corrected=False).record.points
    assert alone.points == pytest.approx(measured, abs=1e-5), "a bag has the contacts as they were made"
    assert alone.contact_times == pytest.approx(contacts.times, abs=1e-4)


def test_uncertainty_and_certificate_are_shown(runs):
    shown = playback(runs[0])
    own = np.loadtxt(runs[0] / "contact_errors.csv", delimiter=",", skiprows=1)
    assert shown.sigmas == pytest.approx(1e-3 * own[:, 2])
    cloud = lp.mapping.clouds.read_cloud(runs[0] / "hiding.ply")
    assert (shown.hiding == cloud.points).all()
    s = lp.open_run(runs[0]).summary
    between_points = np.sqrt(3.0) * s.certificate["grid_mm"]  # what a ball may be larger by than the grid's points tell
    assert s.certified_mm - between_points < 1e3 * shown.sizes.max() < s.certified_mm + 0.012
    spread = np.linspace(1e-5, 5e-5, len(shown.sigmas))  # in an ideal world, those of the run may be all the same
    viewer = Viewer(replace(shown, sigmas=spread), port=0)
    try:
        viewer._handles["colour"].value = "uncertainty"
        painted = viewer._handles["points"].colors.reshape(-1, 3)
        assert len(np.unique(painted, axis=0)) > 3
        assert not viewer._handles["hiding"].visible
        viewer._handles["box hiding"].value = True
        assert viewer._handles["hiding"].visible
    finally:
        viewer.close()


def test_without_a_bag_the_arm_follows_the_path_of_the_sphere(runs):
    shown = playback(runs[1])
    places = np.array([shown.robot.fk(q).A[:3, 3] for q in shown.joints[::20]])
    assert np.abs(places - shown.tips[::20, :3, 3]).max() < 1e-4
    trace = lp.open_run(runs[1]).trace
    assert shown.end == pytest.approx(trace[-1, 0], abs=0.5)


def test_bodies_are_where_their_link_frames_carry_them():
    shown = of_scene(lp.load_scene("block"))
    assert len(shown.shapes) > 5
    poses = posed(shown.robot, shown.joints[0], shown.tips[0], shown.shapes)
    stick = next(k for k, shape in enumerate(shown.shapes) if shape.name == "stick")
    moved = body(shown.shapes[stick]).vertices @ poses[stick][:3, :3].T + poses[stick][:3, 3]
    assert moved[:, 2].min() > shown.tips[0][2, 3] - 0.006
    for shape in shown.shapes:
        middle = body(shape).vertices
        assert np.abs(middle.max(axis=0) + middle.min(axis=0)).max() < 1e-6


@pytest.mark.realtime
def test_a_recorded_run_in_the_browser(runs, browser, tmp_path):
    shown = playback(runs[0])
    contacts = shown.contact_times
    viewer = Viewer(shown, port=0)
    stop = threading.Event()
    thread = threading.Thread(target=viewer.play, args=(stop,))
    thread.start()
    try:
        whole = picture(browser, viewer.url, tmp_path / "whole.png", lambda image: share(image, (255, 255, 255)) < 0.97)

        def earlier(page):
            viewer._handles["time"].value = 0.5 * contacts[0]
            page.get_by_text("0 contacts", exact=False).first.wait_for(timeout=60_000)

        picture(
            browser,
            viewer.url,
            tmp_path / "begin.png",
            lambda image: share(image, (255, 255, 255)) < 0.97 and np.abs(whole - image).max() > 80,
            earlier,
        )
    finally:
        stop.set()
        thread.join()
        viewer.close()


@pytest.mark.realtime
def test_fifty_thousand_points_in_the_browser(browser, tmp_path):
    shown = of_scene(lp.load_scene("block"))
    generator = np.random.default_rng(1)
    shown.points = generator.uniform((-0.05, -0.025, 0.0), (0.05, 0.025, 0.05), (50_000, 3))
    shown.normals = np.tile([0.0, 0.0, 1.0], (50_000, 1))
    shown.contact_times, shown.forces = np.linspace(0.0, 100.0, 50_000), np.full(50_000, 0.8)
    shown.confidence = np.ones(50_000)
    viewer = Viewer(shown, port=0)
    try:
        middle_of_the_ramp = (33, 145, 140)  # 0.8 N of 1.6 N
        picture(browser, viewer.url, tmp_path / "many.png", lambda image: share(image, middle_of_the_ramp, 120) > 0.005)
    finally:
        viewer.close()


@pytest.mark.realtime
def test_a_run_that_goes_on_in_the_browser(browser, tmp_path):
    scene = lp.load_scene("sphere", {"strategy.step": 0.04, "run.seed": 5, "truth.profile": "ideal"})
    viewer = Viewer(of_scene(scene), port=0, live=True)
    counts = []
    try:
        with lp.Session(scene, progress=False) as session:
            for _ in session:
                viewer.update(session)
                if len(session.contacts) > 300 and not counts:
                    counts.append(len(session.contacts))
                    text = viewer._handles["text"].content
                    break
        assert "contacts" in text
        picture(browser, viewer.url, tmp_path / "live.png", lambda image: share(image, (255, 255, 255)) < 0.97)
    finally:
        viewer.close()


def test_a_film_moves_and_is_small(runs, tmp_path):
    seen = []
    path = write_film(runs[0], tmp_path / "film.gif", seconds=1.0, rate=6, width=320, watch=lambda k, n: seen.append(k))
    film = Image.open(path)
    assert film.size == (320, 180)
    assert seen == [1, 2, 3, 4, 5, 6]
    frames = []
    for k in range(film.n_frames):
        film.seek(k)
        frames.append(np.asarray(film.convert("RGB")).astype(int))
    assert len(frames) >= 5
    assert all(np.abs(a - b).max() > 50 for a, b in pairwise(frames))
    assert path.stat().st_size < 500_000


def test_a_film_as_mp4_is_read_by_ffmpeg(runs, tmp_path):
    from imageio_ffmpeg import count_frames_and_secs, get_ffmpeg_exe

    path = write_film(runs[1], tmp_path / "film.mp4", seconds=1.0, rate=5, width=320)
    count, seconds = count_frames_and_secs(str(path))
    assert count == 5 + round(1.5 * 5)
    assert seconds == pytest.approx(count / 5, abs=0.2)
    assert subprocess.run([get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "null", "-"]).returncode == 0


def test_ffmpeg_ends_with_a_film_that_fails(tmp_path):
    def pictures():
        yield Image.new("RGB", (320, 180))
        raise ValueError("no second picture")

    def running():
        children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
        known = (Path(f"/proc/{pid}/comm") for pid in children)
        return [name for name in (file.read_text() for file in known) if "ffmpeg" in name]

    with pytest.raises(ValueError, match="no second picture") as failure:
        _write_video(tmp_path / "film.mp4", pictures(), 5)
    assert running() == [], failure  # which keeps alive what the frames of the failure hold


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_a_film_that_fails_leaves_the_one_that_was_there(runs, tmp_path, ending):
    film = tmp_path / f"film.{ending}"
    film.write_text("as it was")

    def stop(done, of):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_film(runs[0], film, seconds=1.0, rate=6, width=320, watch=stop)
    assert [file.name for file in tmp_path.iterdir()] == [film.name]
    assert film.read_text() == "as it was"


def test_films_that_cannot_be_are_refused(runs, tmp_path):
    with pytest.raises(InputError, match="gif"):
        write_film(runs[0], tmp_path / "film.avi")
    with pytest.raises(InputError, match="pixels"):
        write_film(runs[0], tmp_path / "film.gif", width=10)


def test_two_runs_on_one_page(runs, tmp_path):
    page = write_comparison(runs[0], runs[1], tmp_path / "compared.html").read_text()
    for run in map(lp.open_run, runs):
        assert f"<td>{run.summary.mesh_error_mm['mean']:.3f} mm</td>" in page
        assert f"<td>{run.summary.sim_time_s:.1f} s</td>" in page
    assert page.count("<img") == 4
    assert page.count("<svg") == 3
    assert "Deviation from the true shape" in page


@pytest.mark.parametrize("empty", [[0], [1], [0, 1]])
def test_runs_without_a_mesh_are_compared_in_all_but_the_deviation(runs, tmp_path, empty):
    copies = [shutil.copytree(run, tmp_path / f"{k}") for k, run in enumerate(runs)]
    none = TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
    for k in empty:
        write_mesh(copies[k] / "mesh.stl", none)
        assert lp.open_run(copies[k]).mesh is None
        assert playback(copies[k]).mesh is None
    page = write_comparison(*copies, tmp_path / "compared.html").read_text()
    assert "One of the runs has no mesh" in page
    assert "nan" not in page
    assert page.count("<svg") == 3


def test_a_broken_mesh_is_told_and_not_taken_for_none(runs, tmp_path):
    copy = shutil.copytree(runs[0], tmp_path / "broken")
    (copy / "mesh.stl").write_bytes((copy / "mesh.stl").read_bytes()[:-7])
    with pytest.raises(FormatError, match=r"mesh\.stl"):
        playback(copy)
    with pytest.raises(FormatError, match=r"mesh\.stl"):
        write_comparison(copy, runs[1], tmp_path / "compared.html")


def test_runs_without_a_truth_deviate_from_each_other(runs, tmp_path):
    import json

    copies = []
    for run in runs:
        copy = tmp_path / run.name
        shutil.copytree(run, copy)
        known = json.loads((copy / "summary.json").read_text())
        (copy / "summary.json").write_text(json.dumps(known | {"link_collisions": None}))
        copies.append(copy)
    page = write_comparison(copies[0], copies[0], tmp_path / "same.html").read_text()
    assert "the other run&#x27;s mesh" in page or "the other run's mesh" in page
    assert page.count("mean of the vertices 0.000 mm") == 2
    page = write_comparison(*copies, tmp_path / "compared.html").read_text()
    assert page.count("mean of the vertices") == 2


def test_a_mesh_of_few_large_triangles_is_compared_with_its_surface():
    """The triangle whose middle was nearest had been taken, and its plane: 19 mm between two equal boxes."""
    coarse = trimesh.creation.box((0.1, 0.05, 0.02))
    fine = coarse.copy()
    for _ in range(4):
        fine = fine.subdivide()
    coarse, fine = (TriangleMesh(np.array(mesh.vertices), np.array(mesh.faces)) for mesh in (coarse, fine))
    assert np.abs(_from_mesh(fine, coarse)).max() < 1e-9
    away = TriangleMesh(fine.vertices * [1.0, 1.0, 1.1], fine.faces)
    assert _from_mesh(away, coarse).max() == pytest.approx(0.001, rel=0.05)
