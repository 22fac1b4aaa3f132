"""`lwrprobe map`: look into an OctoMap file, or turn it into a cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Look into an OctoMap file (.bt, .ot) or turn it into a point cloud.", no_args_is_help=True)


@app.command()
def info(file: Annotated[Path, typer.Argument(help="A .bt or .ot file.")]) -> None:
    """Resolution, number of voxels, bounds."""
    from lwrprobe.mapping import describe

    for key, value in describe(file).items():
        typer.echo(f"{key:<20} {value}")


@app.command()
def cloud(
    file: Annotated[Path, typer.Argument(help="A .bt or .ot file.")],
    out: Annotated[Path, typer.Option(help="Where to, by ending: .pcd, .ply, .csv.")],
) -> None:
    """Voxel centres of the occupied space, pruned leaves expanded (as octree2pointcloud does)."""
    from lwrprobe.mapping import to_cloud

    count = to_cloud(file, out)
    typer.echo(f"{count} points in {out}")
