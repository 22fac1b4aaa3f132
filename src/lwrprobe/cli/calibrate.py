"""`lwrprobe calibrate SCENE`: probe, sensor, arm, clocks and table, measured on a reference sphere."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lwrprobe.cli.shared_options import Arm, Confirmed, Sensor, Settings, overrides
from lwrprobe.errors import InputError

if TYPE_CHECKING:
    from lwrprobe.calibration import Calibration

ROWS: tuple[tuple[str, str, tuple[str, ...], float, str], ...] = (
    ("tool_shift", "sphere's centre", ("x", "y", "length"), 1e3, "mm"),
    ("sphere_radius", "sphere's radius", ("",), 1e3, "mm"),
    ("stick_stiffness", "stick", ("across", "along"), 1e-3, "N/mm"),
    ("arm_stiffness", "arm", ("x", "y", "z"), 1e-3, "N/mm"),
    ("force_to_torque", "torque for a force", ("tx/fx", "tx/fy", "tx/fz", "ty/fx", "ty/fy", "ty/fz", "tz/fx", "tz/fy",
                                               "tz/fz"), 1e3, "mm"),
    ("clock_offset", "clocks apart", ("",), 1e3, "ms"),
    ("arm_delay", "arm's delay", ("",), 1e3, "ms"),
    ("sensor_latency", "sensor's latency", ("",), 1e3, "ms"),
    ("table", "table", ("height",), 1e3, "mm"),
    ("payload", "payload", ("mass",), 1e3, "g"),
    ("payload", "payload's middle", ("", "x", "y", "z"), 1e3, "mm"),
    ("joint_hysteresis", "joints' play", ("",), 57.29578, "deg"),
    ("joint_offset", "joint offset", ("1", "2", "3", "4", "5", "6", "7"), 57.29578, "deg"),
)  # fmt: skip
"""Quantity, its words, those of its numbers, factor and unit for reading."""


def calibrate(
    scene: Annotated[
        str, typer.Argument(help="Built-in scene or scene file; the reference sphere stands in the middle of its area.")
    ],
    reference_sphere: Annotated[
        float, typer.Option("--reference-sphere", metavar="M", help="Diameter of the reference sphere in m.")
    ],
    arm: Arm = None,
    sensor: Sensor = None,
    poses: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y", help="Place of a reference sphere in m; give several for the joints' offsets, too."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write.")] = Path("calibration.toml"),
    settings: Settings = None,
    confirm: Confirmed = 0,
) -> None:
    """Measure probe, sensor, arm, clocks and table on a reference sphere, and write calibration.toml.

    The arm touches the sphere from many sides, in four to five minutes; with --poses, at each place. Scenes refer to
    the file by their key `calibration`.
    """
    from lwrprobe.cli.checks import check_output, check_plugins
    from lwrprobe.scene import load_scene

    changes = overrides(settings, {"arm.driver": arm, "sensor.driver": sensor})
    check_output("--out", out, [".toml"])
    loaded = load_scene(scene, changes, check=check_plugins)
    from lwrprobe.calibration import write_calibration
    from lwrprobe.exploration.procedures.calibrate import calibrate as run
    from lwrprobe.exploration.safety.confirm import Confirm

    asking = Confirm(confirm, typer.echo) if confirm > 0 else None
    places = [_place(text) for text in poses or []]
    found, measured = run(
        loaded, reference_sphere, lambda text: typer.echo(text, err=True), confirm=asking, poses=places
    )
    write_calibration(found, out)
    for line in _lines(found):
        typer.echo(line)
    typer.echo(f"peak force      {measured.outcome.peak_force:.2f} N in {found.time:.0f} s, {found.touches} touches")
    typer.echo(f"residual        {1e3 * found.residual:.3f} mm")
    typer.echo(f"wrote {out}: use it with the scene's key calibration, or --set 'calibration=\"{out}\"'")


def _place(text: str) -> tuple[float, float]:
    """x and y in m."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError("--poses", text, "x,y in m") from None
    return x, y


def _lines(found: Calibration) -> list[str]:
    """One for each number: value, standard deviation, and whether the touches show it."""
    lines = []
    for name, words, parts, factor, unit in ROWS:
        quantity = found.quantities[name]
        for part, value, sigma, visible in zip(parts, quantity.values, quantity.sigma, quantity.visible):
            if not part and len(parts) > 1:
                continue
            text = f"{words} {part}".strip()
            seen = "" if visible else "   not visible"
            lines.append(f"{text:<28} {factor * value:10.3f} ± {factor * sigma:.3f} {unit}{seen}")
    return lines
