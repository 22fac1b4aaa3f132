"""`lwrprobe weigh SCENE`: mass and centre of mass of the probe, from four inclined poses of the sensor."""

from __future__ import annotations

from typing import Annotated

import typer

from lwrprobe.cli.shared_options import Confirmed, Settings


def weigh(
    scene: Annotated[
        str, typer.Argument(help="Built-in scene or scene file; the space above its start pose must be free.")
    ],
    settings: Settings = None,
    confirm: Confirmed = 0,
) -> None:
    """Identify mass and centre of mass of what is mounted on the sensor; the arm moves above the scene's start pose.

    Prints the two settings to put into the scene.
    """
    from lwrprobe.cli.checks import check_plugins
    from lwrprobe.scene import load_scene

    loaded = load_scene(scene, settings or [])
    check_plugins(loaded)
    from lwrprobe.exploration.procedures.weigh import weigh as run
    from lwrprobe.exploration.safety.confirm import Confirm

    asking = Confirm(confirm, typer.echo) if confirm > 0 else None
    result = run(loaded, asking)
    found, stated = result.found, result.stated
    typer.echo(f"mass            {1e3 * found.mass:.2f} g (the scene says {1e3 * stated.mass:.2f} g)")
    typer.echo("centre of mass  " + ", ".join(f"{1e3 * v:.2f}" for v in found.com) + " mm in the sensor frame")
    typer.echo("residual force  " + ", ".join(f"{1e3 * v:.2f}" for v in found.residual[:3]) + " mN")
    for setting in result.settings():
        typer.echo(f"--set '{setting}'")
