"""`lwrprobe emulate NAME ...`: the emulated devices, for use without hardware."""

from __future__ import annotations

from typing import Any

import typer

from lwrprobe.cli.checks import check_name
from lwrprobe.cli.help_page import Command, Group
from lwrprobe.contracts.plugins import discover, load, names


class Emulator(Command):
    """One entry of the group `lwrprobe.emulators`: it reads its own arguments, `--help` too."""

    def parse_args(self, context: Any, args: list[str]) -> list[str]:
        context.args = list(args)
        return context.args

    def invoke(self, context: Any) -> Any:
        name, arguments = str(self.name), list(context.args)
        emulator = load("emulator", name)
        asks_for_help = "--help" in arguments
        if name == "rig" and arguments and not arguments[0].startswith("-") and "--joints" not in arguments:
            arguments += [] if asks_for_help else ["--joints", _start_of(arguments[0])]
        raise typer.Exit(emulator.run(arguments))


class Emulators(Group):
    """A command for each emulator that is installed."""

    def list_commands(self, context: Any) -> list[str]:
        return names("emulator")

    def get_command(self, context: Any, name: str) -> Emulator | None:
        return Emulator(name, help=_summary(name)) if name in names("emulator") else None

    def resolve_command(self, context: Any, args: list[str]) -> Any:
        if args and not args[0].startswith("-"):
            check_name("emulator", args[0])
        return super().resolve_command(context, args)


app = typer.Typer(
    cls=Emulators,
    help="Run an emulated device on real sockets; `lwrprobe emulate NAME --help` lists its options.",
    no_args_is_help=True,
    subcommand_metavar="NAME [ARGS]...",
)


@app.callback()
def _group() -> None: ...


def _summary(name: str) -> str:
    """The first line of an emulator's own description, or why there is none."""
    plugin = next(plugin for plugin in discover("emulator") if plugin.name == name)
    if plugin.broken:
        return f"broken: {plugin.broken}"
    return (plugin.loaded.__doc__ or "").strip().partition("\n")[0]


def _start_of(scene: str) -> str:
    """Where an exploration of the scene begins, so that the emulated arm stands there and not a metre away."""
    from math import degrees

    from lwrprobe.scene import load_scene

    loaded = load_scene(scene)
    from lwrprobe.exploration.procedures.start_posture import start_posture
    from lwrprobe.scene.scene_robot import robot_of

    _, q = start_posture(loaded, robot_of(loaded))
    return ",".join(f"{degrees(angle):.6f}" for angle in q)
