"""`lwrprobe reconstruct` and `lwrprobe fit`: a mesh, or simple shapes, from contact points."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from lwrprobe.cli.shared_options import Json, key_values

Source = Annotated[
    Path, typer.Argument(help="A run folder, a cloud (.pcd, .ply, .csv) or a map (.bt, .ot).", show_default=False)
]
Radius = Annotated[
    float | None,
    typer.Option("--probe-radius", metavar="M", help="Radius of the probe's sphere in m; a run folder contains it."),
]
Table = Annotated[
    float | None, typer.Option("--table", metavar="M", help="Height of the table in m; a run folder contains it.")
]


def reconstruct(
    source: Source,
    method: Annotated[
        str, typer.Option(metavar="NAME", help="Reconstructor (see `lwrprobe list reconstructors`).")
    ] = "contact_surface",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Option of the method: step=0.001; repeatable."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Mesh to write: .stl, .ply (with the expected error of each vertex), .obj or .glb; "
            "SOURCE_METHOD.stl if left out.",
        ),
    ] = None,
    probe_radius: Radius = None,
    table: Table = None,
    as_json: Json = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show no progress.")] = False,
) -> None:
    """Make a mesh from contact points."""
    from lwrprobe.cli.bar import StageBar
    from lwrprobe.cli.checks import beside, check_input, check_name, check_output
    from lwrprobe.reconstruction.meshes import WRITERS, write_mesh

    check_input("source", source)
    check_name("reconstructor", method)
    check_output("--out", out, WRITERS)
    from lwrprobe.evaluation.touch_source import read_touches
    from lwrprobe.reconstruction.reconstruct import reconstruct as run

    options = _options(settings or [])
    with StageBar(quiet) as bar:
        bar("reading", 0.0)
        record = read_touches(source, probe_radius, table)
        found = run(record, method, bar, **options)
    path = write_mesh(out or beside(source, f"_{method}.stl"), found.mesh)
    report = _plain(found.report) | {"vertices": len(found.mesh.vertices), "faces": len(found.mesh.faces)}
    if as_json:
        typer.echo(json.dumps(report | {"mesh": str(path)}))
        return
    typer.echo(f"{path}: {report['faces']} triangles, {'closed' if report['watertight'] else 'open'}")
    typer.echo(f"{len(record.points)} points, {report['seconds']:.2f} s")
    if report.get("instead_of_contact_surface"):
        typer.echo(f"not contact_surface: {report['instead_of_contact_surface']}")
    if report.get("unreachable_share"):
        typer.echo(f"{report['unreachable_share']:.1%} of the vertices lie where no sphere of this size can touch")
    if report["without"]:
        typer.echo(f"the record does not have, so the mesh is made without: {', '.join(report['without'])}")


def fit(source: Source, probe_radius: Radius = None, table: Table = None, as_json: Json = False) -> None:
    """Fit a plane, a box, a cylinder and a sphere to contact points, and say which one explains them."""
    from dataclasses import asdict

    from lwrprobe.cli.checks import check_input

    check_input("source", source)
    from lwrprobe.evaluation.touch_source import read_touches
    from lwrprobe.reconstruction.fits import fit as run

    fits = run(read_touches(source, probe_radius, table))
    if as_json:
        typer.echo(json.dumps([_plain(asdict(found)) for found in fits]))
        return
    for found in fits:
        typer.echo(str(found))


def _options(settings: list[str]) -> dict[str, Any]:
    import tomllib

    options: dict[str, Any] = {}
    for key, text in key_values(settings).items():
        try:
            options[key] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            options[key] = text
    return options


def _plain(value: Any) -> Any:
    """As JSON knows it."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value
