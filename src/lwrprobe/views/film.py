"""A film of a run: the arm explores, the mesh grows, with its error and the time beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from lwrprobe.contracts import (
    InputError,
    LwrprobeError,
    MissingExtraError,
    StorageError,
    TriangleMesh,
)
from lwrprobe.evaluation.mesh_error import mean_error
from lwrprobe.evaluation.ramps import ERROR
from lwrprobe.evaluation.render import Sight, View, render_points
from lwrprobe.evaluation.run_folder import RunFolder, read_run
from lwrprobe.reconstruction.reconstruct import reconstruct
from lwrprobe.scene.solid import Solid
from lwrprobe.views.playback import Playback, body, playback, posed

ENDINGS = (".gif", ".mp4", ".webm")
WIDTH, HEIGHT = 640, 360
MESHES = 8
"""How often the mesh is made during the run."""
LAST = 1.5
"""s for which the last picture stands still."""
FEWEST = 40
"""Contacts from which on a mesh is made."""

_ARM, _PROBE, _SPHERE = (0.80, 0.82, 0.84), (0.35, 0.42, 0.50), (0.80, 0.22, 0.16)
_MESH = np.array([0.98, 0.70, 0.40])
_INK, _FAINT = "#22303c", "#7b8794"
_BAR = 34

Watch = Callable[[int, int], None]


def write_film(
    folder: str | Path,
    out: str | Path,
    *,
    seconds: float = 10.0,
    rate: int = 12,
    width: int = WIDTH,
    watch: Watch = lambda done, of: None,
) -> Path:
    """Write a film of a run folder.

    Parameters
    ----------
    out : `.gif`, or `.mp4` and `.webm` with the extra `film`
    seconds, rate : of the film, whatever the run took; Hz
    width : pixels; the height is 9/16 of it
    watch : shown the number of pictures that are done, and of all

    Raises FormatError for what is no run, InputError for another ending or size, StorageError, MissingExtraError.
    """
    out = Path(out)
    if out.suffix.lower() not in ENDINGS:
        raise InputError("--out", str(out), f"a name that ends in {', '.join(ENDINGS)}")
    for name, value, least, most, unit in (
        ("seconds", seconds, 0.5, 600.0, "s"), ("rate", rate, 1, 60, "Hz"), ("width", width, 160, 3840, "pixels"),
    ):  # fmt: skip
        if not least <= value <= most:
            raise InputError(name, value, f"{least:g} to {most:g} {unit}")
    pictures = _Pictures(read_run(folder), playback(folder), width)
    count = max(2, round(seconds * rate))
    frames = (_shown(picture, k, count, watch) for k, picture in enumerate(pictures.all(count)))
    part = out.with_name(f"{out.stem}.part{out.suffix}")
    try:
        if out.suffix.lower() == ".gif":
            _write_gif(part, frames, rate)
        else:
            _write_video(part, frames, rate)
        part.replace(out)
    except OSError as error:
        raise StorageError(out, error) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
    return out


def _shown(picture: Any, k: int, count: int, watch: Watch) -> Any:
    watch(k + 1, count)
    return picture


class _Pictures:
    """The pictures of one run, from one viewpoint."""

    def __init__(self, run: RunFolder, shown: Playback, width: int) -> None:
        self._run, self._shown = run, shown
        self._solid: Solid | None = run.true_solid()
        low, high = np.array(run.scene.area.lower), np.array(run.scene.area.upper)
        low[2] = 0.0
        high[2] = high[2] + 0.07  # stick, sensor and some of the arm
        self._width, self._height = width // 2 * 2, width * 9 // 32 * 2
        bar = _BAR * width // WIDTH
        self._view = View(np.radians(-58.0), np.radians(24.0), low, high, self._width, self._height - 2 * bar)
        self._bodies = [(shape, body(shape)) for shape in shown.shapes]
        self._ball = _ball(run.scene.probe.radius)

    def all(self, count: int) -> Iterator[Any]:
        times = np.linspace(0.0, self._shown.end, count)
        stages = np.linspace(0.0, self._shown.end, MESHES + 1)[1:]
        mesh, error, stage = None, None, 0
        for time in times:
            while stage < len(stages) and time >= stages[stage] - 1e-9:
                mesh, error = self._mesh(float(stages[stage]), stage == len(stages) - 1)
                stage += 1
            yield self._picture(float(time), mesh, error)

    def _mesh(self, time: float, last: bool) -> tuple[TriangleMesh | None, float | None]:
        """What the contacts up to a time make, and its mean error [mm]."""
        run, scene = self._run, self._run.scene
        n = int(np.searchsorted(run.times, time, side="right"))
        if last and self._shown.mesh is not None:
            made = self._shown.mesh
        elif n < FEWEST:
            return None, None
        else:
            try:
                made = reconstruct(run.until(time), scene.reconstruction.method, **scene.reconstruction.options).mesh
            except LwrprobeError:
                return None, None
        if not len(made.faces):
            return None, None
        if self._solid is None:
            return made, None
        try:
            return made, 1e3 * mean_error(made, self._solid, scene.area.lower[2], 800)
        except LwrprobeError:
            return made, None

    def _picture(self, time: float, mesh: TriangleMesh | None, error: float | None) -> Any:
        from PIL import Image, ImageDraw, ImageFont

        shown = self._shown
        k, count = shown.at(time), shown.touched(time)
        sheet = Image.new("RGB", (self._width, self._height), "white")
        bar = (self._height - self._view.height) // 2
        parts, colours = self._arm(k), []
        if mesh is not None:
            parts.insert(0, (mesh, tuple(_MESH)))
        scenery = _joined(parts)
        for part, colour in parts:
            colours.append(np.tile(colour, (len(part.vertices), 1)))
        layers = [Sight(scenery, self._view).paint(np.vstack(colours))]
        if count and mesh is None:
            share = shown.forces[:count] / max(2.0 * self._run.scene.contact.target, 1e-9)
            layers.insert(0, render_points(shown.points[:count], ERROR.colours(share), self._view, 7e-4))
        elif count:  # those that the mesh does not contain yet
            fresh = shown.contact_times[:count] > time - 0.12 * shown.end
            if fresh.any():
                paint = np.tile((0.12, 0.35, 0.60), (int(fresh.sum()), 1))
                layers.append(render_points(shown.points[:count][fresh], paint, self._view, 6e-4))
        for layer in layers:
            picture = Image.fromarray(layer)
            sheet.paste(picture, (0, bar), picture)
        pen, size = ImageDraw.Draw(sheet), 15 * self._width // WIDTH
        font = ImageFont.load_default(size)
        scene = self._run.scene
        pen.text((size, bar // 2), scene.title or scene.name, _INK, font, "lm")
        facts = f"{time:.0f} s    {count} contacts"
        facts += f"    mesh error {error:.2f} mm" if error is not None else ""
        pen.text((size, self._height - bar // 2), scene.strategy.name, _FAINT, font, "lm")
        pen.text((self._width - size, self._height - bar // 2), facts, _INK, font, "rm")
        return sheet

    def _arm(self, k: int) -> list[tuple[TriangleMesh, tuple[float, float, float]]]:
        shown = self._shown
        tip = shown.tips[k]
        poses = posed(shown.robot, shown.joints[k], tip, [shape for shape, _ in self._bodies])
        found = []
        for (shape, surface), pose in zip(self._bodies, poses):
            moved = surface.vertices @ pose[:3, :3].T + pose[:3, 3]
            colour = _PROBE if shape.carrier == "tip" else _ARM
            found.append((TriangleMesh(moved, surface.faces), colour))
        found.append((TriangleMesh(self._ball.vertices + tip[:3, 3], self._ball.faces), _SPHERE))
        return found


def _ball(radius: float) -> TriangleMesh:
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    return TriangleMesh(np.asarray(made.vertices, dtype=np.float64), np.asarray(made.faces, dtype=np.int64))


def _joined(parts: list[tuple[TriangleMesh, tuple[float, float, float]]]) -> TriangleMesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh, _ in parts[:-1])])
    vertices = np.vstack([mesh.vertices for mesh, _ in parts])
    return TriangleMesh(vertices, np.vstack([mesh.faces + start for (mesh, _), start in zip(parts, starts)]))


def _write_gif(out: Path, frames: Iterator[Any], rate: int) -> None:
    """One palette for all pictures, and no dithering: what does not change stays the same from picture to picture."""
    from PIL import Image

    pictures = list(frames)
    palette = pictures[-1].quantize(128, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    times = [round(1000 / rate)] * (len(few) - 1) + [round(1000 * LAST)]
    few[0].save(out, "gif", save_all=True, append_images=few[1:], duration=times, loop=0, optimize=True)


def _write_video(out: Path, frames: Iterator[Any], rate: int) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise MissingExtraError(f"a film {out.suffix}", "imageio-ffmpeg", "film") from None
    first = next(frames)
    writer = imageio_ffmpeg.write_frames(str(out), first.size, fps=rate, macro_block_size=2, ffmpeg_log_level="error")
    with closing(writer):
        writer.send(None)
        picture = first
        writer.send(np.asarray(picture).tobytes())
        for picture in frames:
            writer.send(np.asarray(picture).tobytes())
        for _ in range(round(LAST * rate)):
            writer.send(np.asarray(picture).tobytes())
