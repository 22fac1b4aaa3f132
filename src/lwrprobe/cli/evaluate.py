"""`lwrprobe evaluate`: a run, a mesh or a cloud against the ground truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer


def evaluate(
    subject: Annotated[
        Path, typer.Argument(help="Run folder, mesh (.stl, .ply, .obj, .glb) or cloud (.pcd, .ply, .csv, .bt).")
    ],
    truth: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Scene, scene file or closed mesh; a run's own scene if left out."),
    ] = None,
    align: Annotated[
        bool, typer.Option("--align", help="First align the subject with the ground truth (rigid registration).")
    ] = False,
    above: Annotated[
        float | None,
        typer.Option(metavar="M", help="Compare only what lies above this height in m; the scene's area if left out."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for deviation.ply and deviation.png.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Compare with the ground truth: distances both ways, volume, normals, coverage, errors by facing."""
    from lwrprobe.cli.checks import check_folder, check_input, check_run
    from lwrprobe.errors import InputError

    if truth is None and subject.is_dir():
        check_run("subject", subject)
    check_input("subject", subject)
    if truth is None and not subject.is_dir():
        raise InputError("--truth", "nothing", "a scene or a closed mesh; only a run folder contains its own scene")
    check_folder("--out", out)
    from lwrprobe.evaluation.align import align as lay_over
    from lwrprobe.evaluation.truth import read_truth

    solid, lowest = read_truth(truth if truth is not None else str(subject / "scene.toml"))
    above = lowest if above is None else above
    mesh, cloud = _read(subject)
    figures: dict[str, Any] = {"above_m": above}
    if align:
        motion = lay_over(mesh.vertices if mesh is not None else cloud.points, solid)
        figures["alignment"] = {
            "rotation": motion.rotation.tolist(),
            "translation_m": motion.translation.tolist(),
            "angle_rad": motion.angle,
            "rms_before_mm": 1e3 * motion.before,
            "rms_after_mm": 1e3 * motion.after,
        }
        if mesh is not None:
            mesh.vertices = motion.points(mesh.vertices)
        if cloud is not None:
            cloud.points = motion.points(cloud.points)
            cloud.normals = None if cloud.normals is None else motion.directions(cloud.normals)
    if cloud is not None:
        figures["contacts"] = _cloud_figures(cloud, solid, above)
    if mesh is not None:
        figures["mesh"] = _mesh_figures(mesh, solid, above)
        if out is not None:
            _write(out, mesh, solid, above)
    typer.echo(json.dumps(figures)) if as_json else _show(figures)


def _read(subject: Path) -> tuple[Any, Any]:
    """Mesh and cloud, one of which may be missing. A .ply without triangles is a cloud."""
    from lwrprobe.contracts import FormatError
    from lwrprobe.evaluation.touch_source import MAPS, read_touches
    from lwrprobe.mapping.clouds import ENDINGS as CLOUDS
    from lwrprobe.reconstruction.meshes import read_mesh

    if subject.is_dir():
        cloud = read_touches(subject)
        mesh = read_mesh(subject / "mesh.stl") if (subject / "mesh.stl").is_file() else None
        return (mesh if mesh is not None and len(mesh.faces) else None), cloud
    ending = subject.suffix.lower()
    if ending == ".ply":
        try:
            return read_mesh(subject), None
        except FormatError as error:
            if "no triangles" not in str(error):
                raise
    return (None, read_touches(subject)) if ending in (*CLOUDS, *MAPS) else (read_mesh(subject), None)


def _cloud_figures(record: Any, solid: Any, above: float) -> dict[str, Any]:
    from lwrprobe.evaluation import coverage, normal_error, reach, surface_error

    figures: dict[str, Any] = {"count": len(record.points)}
    if not len(record.points):
        return figures
    figures["surface_error_mm"] = surface_error(record.points, solid).as_dict()
    radius = record.probe_radius or 0.005
    if record.normals is not None:
        # From the sphere's centre: on the surface itself the normal jumps at every edge.
        true = solid.nearest(record.points + radius * record.normals).normals
        figures["normal_error_deg"] = normal_error(record.normals, true).as_dict()
        found = reach(solid, radius, max(above, radius))
        figures |= coverage(record.points, record.normals, found, 0.010).as_dict()
    return figures


def _mesh_figures(mesh: Any, solid: Any, above: float) -> dict[str, Any]:
    from lwrprobe.evaluation import mesh_error
    from lwrprobe.evaluation.facings import facing_errors

    facings = [error.as_dict() for error in facing_errors(mesh, solid, above)]
    return {**mesh_error(mesh, solid, above).as_dict(), "facings_mm": facings}


def _write(folder: Path, mesh: Any, solid: Any, above: float) -> None:
    from lwrprobe.contracts import InputError
    from lwrprobe.evaluation.deviation_map import draw_deviation, write_deviation

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(folder), f"a folder that can be written to ({error.strerror})") from None
    for path in (
        write_deviation(folder / "deviation.ply", mesh, solid),
        draw_deviation(folder / "deviation.png", mesh, solid, above),
    ):
        typer.echo(f"wrote {path}", err=True)


def _show(figures: dict[str, Any]) -> None:
    for name, content in figures.items():
        if not isinstance(content, dict):
            typer.echo(f"{name:<20} {content:g}")
            continue
        typer.echo(f"{name}")
        for key, value in content.items():
            if key == "facings_mm":
                for facing in value:
                    typer.echo(
                        f"  facing {facing['facing']:<10} bias {facing['bias']:+.3f}  rms {facing['rms']:.3f}  "
                        f"largest {facing['largest']:+.3f} mm  ({facing['share']:.0%} of the area)"
                    )
            elif isinstance(value, dict):
                typer.echo(f"  {key:<18} " + ", ".join(f"{k} {v:.4g}" for k, v in value.items()))
            elif isinstance(value, float):
                typer.echo(f"  {key:<18} {value:.5g}")
            else:
                typer.echo(f"  {key:<18} {value}")
