"""A page in the browser with arm, probe, object, contacts and map: of a recorded run, or of one that goes on."""

from __future__ import annotations

import threading
from time import monotonic
from typing import Any

import numpy as np

from lwrprobe.contracts import MissingExtraError, TriangleMesh
from lwrprobe.evaluation.ramps import ERROR, HEIGHT, Ramp
from lwrprobe.exploration.recording.run_bag import quaternion
from lwrprobe.mapping import VoxelMap
from lwrprobe.views.playback import Playback, body, posed

EVERY = 0.1
"""s of wall-clock time between two pictures of a run that goes on."""
MAP_EVERY = 2.0
"""s between two pictures of its map."""
POINT, VOXEL = 0.0009, 0.8
"""m of a contact; share of a voxel that a cube fills."""
MAX_VOXELS = 60_000
COLOURS: dict[str, Ramp] = {"force": ERROR, "age": HEIGHT, "confidence": ERROR, "uncertainty": ERROR}

_ARM, _PROBE, _OBJECT, _MESH = (198, 203, 209), (70, 90, 110), (120, 158, 199), (250, 168, 82)
_FREE, _OCCUPIED, _GOAL, _NEAR = (120, 190, 150), (90, 90, 110), (220, 60, 140), (215, 40, 30)


class Viewer:
    """Shows a playback; the page is at `url` as long as the viewer is open.

    Parameters
    ----------
    shown : what is there at the beginning
    host, port : where the page is served; port 0 takes a free one
    live : the run goes on: no time slider, `update` brings what is new

    Raises MissingExtraError.
    """

    def __init__(self, shown: Playback, host: str = "127.0.0.1", port: int = 8080, live: bool = False) -> None:
        try:
            import viser
        except ImportError:
            raise MissingExtraError("the view in the browser", "viser", "view") from None
        self._shown, self._live = shown, live
        self._server = viser.ViserServer(host=host, port=port, label="lwrprobe", verbose=False)
        self.url = f"http://{host}:{self._server.get_port()}"
        self._lock = threading.RLock()
        self._due = self._map_due = 0.0
        self._playing = False
        self._handles: dict[str, Any] = {}
        self._camera()
        self._still()
        self._controls()
        self.show(0.0 if live else shown.end)

    def show(self, time: float) -> None:
        """Everything as it was at a time [s] of the run."""
        with self._lock, self._server.atomic():
            shown = self._shown
            k, count = shown.at(time), shown.touched(time)
            self._place(shown.joints[k], shown.tips[k])
            self._points(count, time)
            self._goal(shown.goals[shown.goals[:, 0] <= time][-1:, 1:4])
            self._clearance(shown.clearances[shown.clearances[:, 0] <= time][-1:, 2:8])
            doing = next((what for at, what in reversed(shown.states) if at <= time), "")
            force = float(shown.forces[count - 1]) if count else 0.0
            self._say(time, count, force, doing)

    def update(self, session: Any) -> None:
        """What a session (`lwrprobe.Session`) has found up to now; at most ten times a second."""
        now = monotonic()
        if now < self._due:
            return
        self._due = now + EVERY
        seen = session.observation
        if seen is None:
            return
        shown, contacts = self._shown, session.contacts
        with self._lock, self._server.atomic():
            shown.points, shown.normals, shown.forces = contacts.points, contacts.normals, contacts.forces
            shown.contact_times, shown.confidence = contacts.times, contacts.confidence
            self._place(session.joints, seen.pose)
            self._points(len(contacts), seen.time)
            if now >= self._map_due:
                self._map_due = now + MAP_EVERY
                self._map(session.map)
            goal = session.goal
            self._goal(np.empty((0, 3)) if goal is None else goal[None])
            near = seen.clearance
            ends = near is not None and np.isfinite(near.distance)
            self._clearance(np.array([[*near.on_robot, *near.on_map]]) if ends else np.empty((0, 6)))
            self._say(seen.time, len(contacts), float(np.linalg.norm(seen.force)), session.doing)

    def finish(self, shown: Playback) -> None:
        """The run has ended: show the whole of it, with a time slider and its mesh."""
        with self._lock:
            self._live = False
            self._server.gui.reset()
            self._server.scene.reset()
            self._handles.clear()
            self._shown = shown
            self._still()
            self._controls()
            self.show(shown.end)

    def play(self, stop: threading.Event) -> None:
        """Serve the page until `stop` is set; moves the slider while it plays."""
        while not stop.wait(EVERY):
            if self._playing and not self._live:
                slider = self._handles["time"]
                later = slider.value + EVERY * self._handles["speed"].value
                slider.value = 0.0 if slider.value >= self._shown.end else min(later, self._shown.end)

    def close(self) -> None:
        """Take the page away."""
        self._server.stop()

    def _camera(self) -> None:
        low, high = np.array(self._shown.scene.area.lower), np.array(self._shown.scene.area.upper)
        middle, wide = 0.5 * (low + high), float(np.linalg.norm(high - low))
        camera = self._server.initial_camera
        camera.position = tuple(middle + wide * np.array([0.55, -1.0, 0.75]))
        camera.look_at = tuple(middle)
        camera.up = (0.0, 0.0, 1.0)

    def _still(self) -> None:
        """What does not move, and the bodies of the arm at first."""
        scene, shown = self._server.scene, self._shown
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_environment_map(None)  # the page must not fetch one from elsewhere
        scene.configure_default_lights(cast_shadow=False)
        scene.add_light_ambient("/ambient", intensity=1.2)
        if shown.scene.table.present:
            scene.add_grid(
                "/table", width=0.6, height=0.6, cell_size=0.02, position=(0.0, 0.0, shown.scene.table.height)
            )
        if shown.truth is not None:
            self._handles["object"] = self._mesh("/object", shown.truth, _OBJECT, 0.35)
        if shown.mesh is not None:
            self._handles["mesh"] = self._mesh("/mesh", shown.mesh, _MESH, None)
            self._handles["mesh"].visible = False
        for number, shape in enumerate(shown.shapes):
            colour = _PROBE if shape.carrier == "tip" else _ARM
            surface = body(shape)
            self._handles[f"body {number}"] = scene.add_mesh_simple(
                f"/arm/{number}_{shape.name}", surface.vertices, surface.faces, color=colour, side="double"
            )
        radius = shown.scene.probe.radius
        self._handles["sphere"] = scene.add_icosphere("/arm/sphere", radius=radius, color=(200, 50, 40))
        if shown.voxels is not None:
            self._map(shown.voxels)
        if len(shown.hiding):
            share = shown.sizes / max(float(shown.sizes.max()), 1e-9)
            self._cloud("hiding", shown.hiding, _bytes(ERROR, share), POINT)

    def _mesh(self, name: str, mesh: TriangleMesh, colour: tuple[int, int, int], opacity: float | None) -> Any:
        return self._server.scene.add_mesh_simple(
            name, mesh.vertices, mesh.faces, color=colour, opacity=opacity, flat_shading=True, side="double"
        )

    def _controls(self) -> None:
        gui, shown = self._server.gui, self._shown
        self._handles["text"] = gui.add_markdown("")
        if not self._live:
            end = max(shown.end, 0.1)
            time = gui.add_slider("time [s]", 0.0, round(end + 0.05, 1), 0.1, round(end, 1))
            self._handles["time"] = time
            self._handles["speed"] = gui.add_slider("speed", 1.0, 50.0, 1.0, 10.0)
            play = gui.add_button("play or pause")
            time.on_update(lambda event: self.show(float(time.value)))

            @play.on_click
            def _toggle(event: Any) -> None:
                self._playing = not self._playing

        colour = gui.add_dropdown("points by", list(COLOURS), initial_value="force")
        self._handles["colour"] = colour
        colour.on_update(lambda event: self._repaint())
        for name, label, on in (
            ("points", "contacts", True), ("object", "true object", True), ("mesh", "mesh", False),
            ("arm", "arm", True), ("occupied", "map", False), ("free", "free space", False),
            ("hiding", "where something may hide", False), ("goal", "next goal", True),
            ("clearance", "clearance line", True),
        ):  # fmt: skip
            box = gui.add_checkbox(label, on)
            self._handles[f"box {name}"] = box
            box.on_update(lambda event: self._visibility())

    def _repaint(self) -> None:
        if self._live:
            self._due = 0.0
        else:
            self.show(float(self._handles["time"].value))

    def _visibility(self) -> None:
        with self._lock:
            for name in ("points", "object", "mesh", "occupied", "free", "hiding", "goal", "clearance"):
                if name in self._handles:
                    self._handles[name].visible = self._handles[f"box {name}"].value
            for name, handle in self._handles.items():
                if name.startswith("body ") or name == "sphere":
                    handle.visible = self._handles["box arm"].value

    def _place(self, joints: np.ndarray, tip: np.ndarray) -> None:
        shown = self._shown
        shapes = shown.shapes
        for number, pose in enumerate(posed(shown.robot, joints, tip, shapes)):
            x, y, z, w = quaternion(pose)
            handle = self._handles[f"body {number}"]
            handle.wxyz, handle.position = (w, x, y, z), pose[:3, 3]
        self._handles["sphere"].position = tip[:3, 3]

    def _points(self, count: int, time: float) -> None:
        shown = self._shown
        by = self._handles["colour"].value if "colour" in self._handles else "force"
        points = shown.points[:count]
        if by == "age":
            share = 1.0 - (time - shown.contact_times[:count]) / max(time, 1e-9)
        elif by == "confidence":
            share = shown.confidence[:count]
        elif by == "uncertainty" and np.isfinite(shown.sigmas).any():
            share = np.nan_to_num(shown.sigmas[:count] / np.nanmax(shown.sigmas), nan=1.0)
        elif by == "uncertainty":  # known at the end of a run alone
            share = np.ones(count)
        else:
            share = shown.forces[:count] / max(2.0 * shown.scene.contact.target, 1e-9)
        self._cloud("points", points, _bytes(COLOURS[by], share), POINT)

    def _map(self, voxels: VoxelMap) -> None:
        self._cloud("occupied", voxels.centres(), _OCCUPIED, VOXEL * voxels.resolution)
        free = voxels.free_centres()
        self._cloud("free", free[:: len(free) // MAX_VOXELS + 1], _FREE, 0.3 * voxels.resolution)

    def _cloud(self, name: str, points: np.ndarray, colours: Any, size: float) -> None:
        visible = self._handles[f"box {name}"].value if f"box {name}" in self._handles else name == "points"
        self._handles[name] = self._server.scene.add_point_cloud(
            f"/{name}", points.astype(np.float32), colours, point_size=size, point_shape="circle", precision="float32",
            visible=bool(visible),
        )  # fmt: skip

    def _goal(self, places: np.ndarray) -> None:
        self._one("goal", len(places) > 0)
        if len(places):
            visible = self._handles["box goal"].value if "box goal" in self._handles else True
            radius = 0.6 * self._shown.scene.probe.radius
            self._handles["goal"] = self._server.scene.add_icosphere(
                "/goal", radius=radius, color=_GOAL, opacity=0.7, position=places[0], visible=bool(visible)
            )

    def _clearance(self, ends: np.ndarray) -> None:
        self._one("clearance", len(ends) > 0)
        if len(ends):
            visible = self._handles["box clearance"].value if "box clearance" in self._handles else True
            self._handles["clearance"] = self._server.scene.add_line_segments(
                "/clearance", ends.reshape(1, 2, 3), _NEAR, thickness=0.0012, visible=bool(visible)
            )

    def _one(self, name: str, there: bool) -> None:
        """Take away what is no longer there."""
        if not there and name in self._handles:
            self._handles.pop(name).remove()

    def _say(self, time: float, count: int, force: float, doing: str) -> None:
        scene = self._shown.scene
        lines = [f"**{scene.title or scene.name}**, {scene.strategy.name}", f"time {time:.1f} s, {count} contacts"]
        lines += [f"force {force:.2f} N", doing] if count or doing else []
        content = "\n\n".join(line for line in lines if line)
        if "text" in self._handles and self._handles["text"].content != content:
            self._handles["text"].content = content


def _bytes(ramp: Ramp, share: np.ndarray) -> np.ndarray:
    """(n, 3) uint8, of shares (n,) of a ramp."""
    return np.round(255.0 * ramp.colours(np.asarray(share))).astype(np.uint8).reshape(-1, 3)
