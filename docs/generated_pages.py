"""Reference pages that are written from the code: the command line, the scene file, the public names."""

from __future__ import annotations

import ast
import inspect
import pkgutil
import types
import typing
from dataclasses import fields
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

INTERNAL = ("lwrprobe.bench", "lwrprobe.cli")
"""Packages whose names are no part of the library's interface."""

CALIBRATING = "reference_sphere"
"""The strategy that `lwrprobe calibrate` drives, which sets its options itself."""


def write(folder: Path) -> None:
    """Write all generated pages into `folder`; a page that did not change keeps its time stamp."""
    folder.mkdir(exist_ok=True)
    pages = {"command-line": command_line(), "scene-file": scene_file()}
    pages |= {name: public_names(name) for name in packages()}
    for stem, text in pages.items():
        page = folder / f"{stem}.md"
        if not page.is_file() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def command_line() -> str:
    """Every command with its arguments and options, from the typer application."""
    from lwrprobe.cli.app import app

    lines = [
        "# Command line",
        "",
        "This page is written from the program; `lwrprobe COMMAND --help` says the same.",
        "",
    ]
    lines += ["Exit codes: 0 done, 1 a run ended early and its data are kept, 2 bad input, 130 interrupted."]
    for name, command in sorted(typer.main.get_command(app).commands.items()):
        for path, leaf in _leaves(name, command):
            lines += _command(path, leaf)
    return "\n".join(lines) + "\n"


def _leaves(path: str, command: Any) -> list[tuple[str, Any]]:
    from lwrprobe.contracts.plugins import load, names

    if path == "emulate":
        return [(f"emulate {name}", typer.main.get_command(load("emulator", name).app)) for name in names("emulator")]
    below = getattr(command, "commands", None)
    if below is None:
        return [(path, command)]
    return [leaf for name, child in sorted(below.items()) for leaf in _leaves(f"{path} {name}", child)]


def _command(path: str, command: Any) -> list[str]:
    arguments = [p for p in command.params if type(p).__name__ == "TyperArgument"]
    options = [p for p in command.params if p not in arguments and not p.hidden]
    words = [p.name.upper() if p.required else f"[{p.name.upper()}]" for p in arguments]
    usage = " ".join(["lwrprobe", path, *words, *(["[OPTIONS]"] if options else [])])
    lines = ["", f"## {path}", "", "```text", usage, "```", "", command.help or ""]
    if arguments or options:
        lines += ["", "| | value | meaning |", "|---|---|---|"]
    lines += [f"| `{p.name.upper()}` | {_value(p)} | {_cell(p.help)} |" for p in arguments]
    lines += [f"| {', '.join(f'`{o}`' for o in p.opts)} | {_value(p)} | {_cell(p.help)} |" for p in options]
    return lines


def _value(parameter: Any) -> str:
    if getattr(parameter, "is_flag", False):
        return "flag"
    kind = parameter.type_descriptor.annotation
    if isinstance(kind, type) and issubclass(kind, Enum):
        return ", ".join(f"`{member.value}`" for member in kind)
    text = _type_text(kind)
    if parameter.default not in (None, "", [], ()) and not callable(parameter.default):
        text += f", default `{parameter.default}`"
    return text


def scene_file() -> str:
    """Every table and key of a scene file, from the models that read it."""
    from lwrprobe.scene.scene import Scene
    from lwrprobe.scene.shape import Shape

    lines = ["# Scene file", "", "This page is written from the models that read the file. A scene file is TOML."]
    lines += ["Every key may be left out. `--set TABLE.KEY=VALUE` on the command line overrides one. An unknown key"]
    lines += ["is an error. Lengths are in metres, angles in degrees where the name ends in `_deg`, else in radians."]
    lines += ["The same as a JSON schema: {download}`scene.schema.json <../scene.schema.json>`."]
    lines += ["", "## Keys before the first table", ""]
    lines += _keys({name: Scene.model_fields[name] for name in ("name", "title")})
    for name, field in ((n, f) for n, f in Scene.model_fields.items() if _model(f.annotation)):
        lines += _table(name, field.annotation)
        lines += _plugin_options(name)
    lines += ["", "## \\[drivers.NAME\\]", "", Scene.model_fields["drivers"].description or ""]
    lines += _drivers()
    lines += ["", "## \\[\\[object\\]\\]", ""]
    for shape in typing.get_args(typing.get_args(Shape)[0]) or typing.get_args(Shape):
        lines += ["", f"### {_shape_name(shape)}", "", _doc(shape), "", *_keys(shape.model_fields)]
    return "\n".join(lines) + "\n"


def _shape_name(shape: type[BaseModel]) -> str:
    return " ".join(f'`shape = "{value}"`' for value in typing.get_args(shape.model_fields["shape"].annotation))


def _table(name: str, model: type[BaseModel]) -> list[str]:
    own = {n: f for n, f in model.model_fields.items() if n != "options"}
    return ["", f"## \\[{name}\\]", "", _doc(model), "", *_keys(own)]


def _drivers() -> list[str]:
    from lwrprobe.contracts.plugins import load

    lines = []
    for name in ("sim", "mujoco", "fri", "ati"):
        config = load("driver", name).Config
        lines += ["", f"### \\[drivers.{name}\\]", "", *_attributes(config)]
    return lines


def _plugin_options(table: str) -> list[str]:
    """The options of each strategy, or of each reconstructor, which stand in the same table as its name."""
    from lwrprobe.contracts.plugins import load, names

    tables = {"strategy": ("strategy", "name"), "reconstruction": ("reconstructor", "method")}
    kind, naming = tables.get(table, ("", ""))
    lines = []
    for name in names(kind) if kind else ():
        config = load(kind, name).Config
        if not config.__module__.rpartition(".")[2].startswith(CALIBRATING) and fields(config):
            lines += ["", f'### Where `{naming} = "{name}"`', "", *_attributes(config)]
    return lines


def _attributes(config: type) -> list[str]:
    """The fields of an options dataclass with the text of the section Attributes, also of what it extends."""
    said, key = {}, ""
    texts = (inspect.cleandoc(base.__doc__ or "") for base in reversed(config.__mro__[:-1]))
    for line in "\n".join(text.partition("----------\n")[2] for text in texts).splitlines():
        name, colon, rest = line.strip().partition(" : ")
        if colon and not line.startswith(" "):
            key = name
            for part in key.split(","):
                said[part.strip()] = rest
        elif line.strip() and key:
            for part in key.split(","):
                said[part.strip()] += " " + line.strip()
    lines = ["| key | default | meaning |", "|---|---|---|"]
    shown = [f for f in fields(config) if not f.name.startswith("_")]
    return lines + [f"| `{f.name}` | {_default(f.default)} | {_cell(said.get(f.name))} |" for f in shown]


def _keys(shown: dict[str, Any]) -> list[str]:
    lines = ["| key | type | default | meaning |", "|---|---|---|---|"]
    for name, field in shown.items():
        kind = " ".join([_type_text(field.annotation), *filter(None, map(_bound, field.metadata))])
        default = "required" if field.is_required() else _default(field.default)
        lines.append(f"| `{field.alias or name}` | {_cell(kind)} | {default} | {_cell(field.description)} |")
    return lines


def _bound(limit: Any) -> str:
    """A bound of annotated_types as text that is not broken over two lines."""
    for name, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤")):
        if hasattr(limit, name):
            return f"{sign}\u00a0{getattr(limit, name):g}"
    return ""


def _default(value: Any) -> str:
    if value is PydanticUndefined or type(value).__name__ == "_MISSING_TYPE":
        return "-"
    if value is None:
        return "none"
    if isinstance(value, BaseModel):
        return " ".join(f"{k} = `{list(v) if isinstance(v, tuple) else v}`" for k, v in value.model_dump().items())
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        return f"`{value:.6g}`"
    if isinstance(value, tuple):
        return f"`{list(value)}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


def _type_text(kind: Any) -> str:
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _type_text(parts[0])
    if origin is typing.Literal:
        return " or ".join(f"`{part}`" for part in parts)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_type_text(part) for part in parts if part is not type(None))
    if origin is tuple:
        return "list of numbers" if Ellipsis in parts else f"list of {len(parts)}"
    if origin is list:
        return f"{_type_text(parts[0])}, repeatable"
    if _model(kind):
        return "table"
    return {str: "text", float: "number", int: "integer", bool: "true or false", Path: "path"}.get(kind, "table")


def _model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _doc(thing: Any) -> str:
    return " ".join((thing.__doc__ or "").split())


def _cell(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|")


def packages() -> list[str]:
    """The library's package and those below it that export names."""
    below = [f"lwrprobe.{found.name}" for found in pkgutil.iter_modules(import_module("lwrprobe").__path__)]
    return ["lwrprobe", *(n for n in below if n not in INTERNAL and getattr(import_module(n), "__all__", ()))]


def public_names(package: str) -> str:
    """Every name in a package's `__all__`, for autodoc to describe; where another package describes it, a link."""
    module = import_module(package)
    others = {name for other in packages()[1:] if other != package for name in import_module(other).__all__}
    lines = [f"# {package}", "", f"```{{eval-rst}}\n.. automodule:: {package}\n   :no-members:\n"]
    names = sorted(module.__all__, key=str.lower)
    for name in names:
        if package != "lwrprobe" or name not in others:
            lines += _directive(package, name, getattr(module, name))
    lines += ["```"]
    if package == "lwrprobe":
        lines += ["", "Also exported, and described in their own packages:"]
        lines += [", ".join(f"`{name}`" for name in names if name in others) + "."]
    return "\n".join(lines) + "\n"


def _directive(package: str, name: str, thing: Any) -> list[str]:
    if isinstance(thing, types.ModuleType):
        return []
    if isinstance(thing, type):
        return ["", f".. autoclass:: {package}.{name}"]
    if callable(thing):
        return ["", f".. autofunction:: {package}.{name}"]
    # A value has no docstring of its own; autodoc reads the text below it, in the module that defines it.
    return ["", f".. autodata:: {_source(package, name)}.{name}"]


def _source(package: str, name: str) -> str:
    for node in ast.parse(inspect.getsource(import_module(package))).body:
        if isinstance(node, ast.ImportFrom) and any(alias.name == name for alias in node.names):
            return node.module or package
    return package
