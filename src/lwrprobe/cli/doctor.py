"""`lwrprobe doctor`: versions, plug-ins, what is missing and how to get it."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import metadata, version
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any

import typer

import lwrprobe
from lwrprobe.cli.shared_options import Settings

if TYPE_CHECKING:
    from packaging.requirements import Requirement

    from lwrprobe.contracts.plugins import Plugin
    from lwrprobe.scene import Scene

MAX_AGE = 90
"""days after which a calibration is to be made again."""
_MARKS = {True: "  ", False: "! ", None: "? "}
"""Before a line: as it should be, a problem, advice."""


def doctor(
    arm: Annotated[
        str | None, typer.Option(metavar="NAME", help="Check the arm behind this driver: connect and read.")
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(metavar="NAME", help="Check the sensor behind this driver: connect and read.")
    ] = None,
    scene: Annotated[
        str, typer.Option(metavar="SCENE", help="Scene whose tables drivers.NAME hold the devices' addresses.")
    ] = "empty",
    settings: Settings = None,
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.5, max=600.0, help="How long to read from a device, in s.")
    ] = 5.0,
) -> None:
    """Check the installation; with --arm or --sensor check a device, which is not moved."""
    from lwrprobe.cli.checks import check_name
    from lwrprobe.scene import load_scene

    for driver in (arm, sensor):
        check_name("driver", driver)
    # Its calibration is one of the things to be checked; a scene that is wrong without it is bad input.
    loaded = load_scene(scene, [*(settings or []), 'calibration=""'])
    if arm is None and sensor is None:
        lines: Iterator[tuple[str, bool | None]] = _installation()
    else:
        lines = _devices([name for name in (arm, sensor) if name is not None], loaded, seconds)
    bad = 0
    for line, good in chain(lines, _calibration(scene, settings or [])):
        typer.echo(_MARKS[good] + line)
        bad += good is False
    typer.echo("no problem found" if not bad else f"problems found: {bad}, in the lines marked with !")
    if bad:
        raise typer.Exit(1)


def _installation() -> Iterator[tuple[str, bool]]:
    from lwrprobe.contracts.plugins import GROUPS, discover
    from lwrprobe.evaluation.machine import machine

    yield f"lwrprobe {lwrprobe.__version__}", True
    for key, value in machine().items():
        yield f"{key:<24} {value}", True
    yield from _libraries()
    for kind in GROUPS:
        for plugin in discover(kind):
            yield _plugin_line(plugin), not plugin.broken


def _devices(names: list[str], loaded: Scene, seconds: float) -> Iterator[tuple[str, bool | None]]:
    from lwrprobe.contracts import DriverContext, DriverError, InputError, MassiveArm
    from lwrprobe.contracts.options import configure
    from lwrprobe.contracts.plugins import load
    from lwrprobe.exploration.loop.devices import delay_of

    faces: dict[str, Any] = {}
    for name in dict.fromkeys(names):
        plugin = load("driver", name)
        config = configure(plugin.Config, loaded.drivers.get(name, {}), f"drivers.{name}")
        driver = plugin(DriverContext(config, loaded))
        try:
            checks = driver.health_checks(seconds)
        except DriverError as error:
            yield f"{name} {'connection':<24} {error}", False
            continue
        faces |= {role: getattr(driver, role)() for role in plugin.roles}
        if not checks:
            raise InputError("driver", name, "a driver of a device: a simulator has nothing to check")
        for reading in checks:
            yield f"{name} {reading.name:<24} {reading.value}", reading.good
    mass = faces["arm"].mass if isinstance(faces.get("arm"), MassiveArm) else 0.0
    if {"arm", "sensor"} <= faces.keys():
        from lwrprobe.exploration.procedures.dry_run import stability

        arm = faces["arm"]
        reading = stability(loaded, arm.cycle, faces["sensor"].latency, mass, delay_of(arm))
        yield f"{loaded.name} {reading.name:<24} {reading.value}", reading.good
    if "arm" in faces:
        from lwrprobe.exploration.procedures.host_stalls import host_checks

        latency = faces["sensor"].latency if "sensor" in faces else 0.0
        arm = faces["arm"]
        for reading in host_checks(loaded, arm.cycle, latency, min(seconds, 5.0), mass, delay_of(arm)):
            # Some seconds beside whatever else runs say what to improve; whether cycles are missed the arm itself says.
            yield f"host {reading.name:<24} {reading.value}", reading.good or None


def _calibration(scene: str, settings: list[str]) -> Iterator[tuple[str, bool]]:
    """What there is to say of the scene's calibration, or why it cannot be used."""
    from lwrprobe.contracts import FormatError, SceneError

    try:
        yield from _age_and_drift(scene, settings)
    except (FormatError, SceneError) as error:
        yield f"{'calibration':<24} {error}", False


def _age_and_drift(scene: str, settings: list[str]) -> Iterator[tuple[str, bool]]:
    """Age and residual of the scene's calibration, and what has changed since the one before; nothing without one."""
    from datetime import UTC, datetime

    from lwrprobe.calibration import drifts, previous_path, read_calibration
    from lwrprobe.scene import load_scene
    from lwrprobe.scene.calibrated_scene import calibration_of

    loaded = load_scene(scene, settings)
    found = calibration_of(loaded)
    if found is None:
        return
    days = (datetime.now(UTC) - found.date).total_seconds() / 86400.0
    facts = f"{days:.0f} days old, residual {1e3 * found.residual:.3f} mm, sphere {1e3 * found.reference_sphere:g} mm"
    good = days <= MAX_AGE
    yield f"{'calibration':<24} {facts}" + ("" if good else f": calibrate again, {MAX_AGE} days are allowed"), good
    if not previous_path(loaded.calibration).is_file():
        return
    before = read_calibration(previous_path(loaded.calibration))
    if before.scene_hash != found.scene_hash:
        return
    since, changed = f"since {before.date:%Y-%m-%d}", drifts(found, before)
    if not changed:
        yield f"{'calibration drift':<24} nothing has changed {since}", True
    for one in changed:
        unit = found.quantities[one.quantity].unit
        yield (
            f"{'calibration drift':<24} {one.quantity}[{one.index}] from {one.before:.6g} to {one.now:.6g} {unit} "
            f"{since}, {one.deviations:.1f} standard deviations: check stick, sphere and sensor",
            False,
        )


def _libraries() -> list[tuple[str, bool]]:
    from packaging.requirements import Requirement

    rows = []
    for text in metadata("lwrprobe").get_all("Requires-Dist") or []:
        need = Requirement(text)
        extra = _extra(need)
        try:
            found = version(need.name)
        except ImportError:
            how = f"pip install 'lwrprobe[{extra}]'" if extra else "pip install --force-reinstall lwrprobe"
            rows.append((f"{need.name:<24} not installed{'' if not extra else ' (optional)'}: {how}", bool(extra)))
            continue
        good = need.specifier.contains(found, prereleases=True)
        rows.append((f"{need.name:<24} {found}" + ("" if good else f", but {need.specifier} is needed"), good))
    return rows


def _extra(need: Requirement) -> str:
    marker = str(need.marker or "")
    return marker.split('"')[1] if marker.startswith("extra") and '"' in marker else ""


def _plugin_line(plugin: Plugin) -> str:
    state = f"broken: {plugin.broken}" if plugin.broken else f"from {plugin.distribution} {plugin.version}"
    return f"{f'{plugin.kind} {plugin.name}':<36} {state}"
