"""`lwrprobe evaluate`: a run, a mesh or a cloud against the ground truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lwrprobe.cli.shared_options import Json

if TYPE_CHECKING:
    from lwrprobe.runs.evaluate import Evaluation


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
    as_json: Json = False,
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
    from lwrprobe.runs.evaluate import evaluate as run

    found = run(subject, truth, above=above, align=align)
    figures = _figures(found)
    for path in [] if out is None else found.save(out):
        typer.echo(f"wrote {path}", err=True)
    typer.echo(json.dumps(figures)) if as_json else _show(figures)


def _figures(found: Evaluation) -> dict[str, Any]:
    """Lengths in mm, angles in degrees, unless the name says otherwise."""
    figures: dict[str, Any] = {"above_m": found.above}
    if found.alignment is not None:
        figures["alignment"] = {
            "rotation": found.alignment.rotation.tolist(),
            "translation_m": found.alignment.translation.tolist(),
            "angle_rad": found.alignment.angle,
            "rms_before_mm": 1e3 * found.alignment.before,
            "rms_after_mm": 1e3 * found.alignment.after,
        }
    if found.contacts is not None:
        contacts: dict[str, Any] = {"count": found.contacts}
        figures["contacts"] = contacts
        if found.points is not None:
            contacts["surface_error_mm"] = found.points.as_dict()
        if found.normals is not None:
            contacts["normal_error_deg"] = found.normals.as_dict()
        if found.coverage is not None:
            contacts |= found.coverage.as_dict()
    if found.mesh is not None:
        facings = [error.as_dict() for error in found.facings()]
        figures["mesh"] = {**found.mesh.as_dict(), "facings_mm": facings}
    return figures


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
                typer.echo(f"  {key:<18} {'not known' if value is None else value}")
