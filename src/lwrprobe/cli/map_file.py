"""`lwrprobe map`: inspect an OctoMap file, or convert it to a point cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lwrprobe.cli.checks import check_input, check_output
from lwrprobe.cli.help_page import Command, Group

app = typer.Typer(
    cls=Group, help="Inspect an OctoMap file (.bt, .ot), or convert it to a point cloud.", no_args_is_help=True
)


@app.command(cls=Command)
def info(file: Annotated[Path, typer.Argument(help="OctoMap file, .bt or .ot.")]) -> None:
    """Print resolution, number of voxels and bounds."""
    check_input("file", file)
    from lwrprobe.mapping import describe

    for key, value in describe(file).items():
        typer.echo(f"{key:<20} {value}")


@app.command(cls=Command)
def cloud(
    file: Annotated[Path, typer.Argument(help="OctoMap file, .bt or .ot.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Cloud to write, .pcd, .ply or .csv.")],
) -> None:
    """Write the centres of the occupied voxels, pruned leaves expanded (as octree2pointcloud does)."""
    check_input("file", file)
    check_output("--out", out)
    from lwrprobe.mapping import to_cloud
    from lwrprobe.mapping.clouds import ENDINGS

    check_output("--out", out, ENDINGS)

    count = to_cloud(file, out)
    typer.echo(f"{count} points in {out}")
