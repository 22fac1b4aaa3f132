"""`lwrprobe weigh SCENE`: what hangs on the sensor, by leaning it to four sides."""

from __future__ import annotations

from typing import Annotated

import typer


def weigh(
    scene: Annotated[str, typer.Argument(help="Built-in scene or scene file; nothing may stand above its start.")],
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value of the scene, repeatable.")] = None,
    confirm: Annotated[int, typer.Option(help="Ask for each of the first so many motions; Enter stops each.")] = 0,
) -> None:
    """Find mass and centre of mass of what hangs on the sensor; the arm moves above the scene's start.

    Prints the two settings that belong into the scene.
    """
    from lwrprobe.exploration.procedures.weigh import weigh as run
    from lwrprobe.exploration.safety.confirm import Confirm
    from lwrprobe.scene import load_scene

    asking = Confirm(confirm, typer.echo) if confirm > 0 else None
    result = run(load_scene(scene, settings or []), asking)
    found, stated = result.found, result.stated
    typer.echo(f"mass            {1e3 * found.mass:.2f} g (the scene says {1e3 * stated.mass:.2f} g)")
    typer.echo("centre of mass  " + ", ".join(f"{1e3 * v:.2f}" for v in found.com) + " mm in the sensor frame")
    typer.echo("left            " + ", ".join(f"{1e3 * v:.2f}" for v in found.residual[:3]) + " mN")
    for setting in result.settings():
        typer.echo(f"--set '{setting}'")
