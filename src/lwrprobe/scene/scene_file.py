"""Reading and writing scene files (TOML), with errors that name file, key, value and what is allowed."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from os.path import isfile
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from lwrprobe.contracts import SceneError, UnknownNameError
from lwrprobe.errors import nearest
from lwrprobe.host.whole_file import write_whole
from lwrprobe.scene import library
from lwrprobe.scene.actual_scene import widened_area
from lwrprobe.scene.calibrated_scene import calibration_of
from lwrprobe.scene.random_scene import random_scene
from lwrprobe.scene.scene import Scene
from lwrprobe.scene.shape import MATERIAL, SHAPES, Shape
from lwrprobe.scene.table import Refusal

Overrides = Mapping[str, Any] | Iterable[str]

_SHAPE_MODELS = {model.model_fields["shape"].annotation.__args__[0]: model for model in get_args(get_args(Shape)[0])}


def load_scene(
    scene: str | Path | Scene,
    overrides: Overrides = (),
    profile: str | None = None,
    check: Callable[[Scene], None] | None = None,
) -> Scene:
    """A scene by name or file, with a profile's tables over its own and `key=value` overrides on top.

    Parameters
    ----------
    scene : a built-in name, a scene file, `random:KIND:SEED` (`random_scene`), or a scene that is there already and
        gets the overrides. Relative mesh files are resolved against the scene file's folder
    overrides : texts `key=value` with the value as in TOML, where a bare word counts as text; or a dict of keys and
        plain values. A key is dotted: `probe.radius`, `object.0.friction`
    profile : a built-in profile (`thesis`) or a file
    check : is called with the scene before its objects are built, which takes long; may raise

    A calibration that is named in `overrides` and not in the file is looked for in the working folder.
    A `[truth]` that moves the objects widens the area (`actual_scene.widened_area`).

    Raises SceneError for wrong content and UnknownNameError for a name that is neither built in
    nor a file.
    """
    path, content = _content(scene, profile)
    settings = _pairs(overrides)
    try:
        stated = _stated(content, settings, path)
    except SceneError as error:
        source = _source(content, settings, path)
        raise SceneError(f"{source}: {error.field}", error.value, error.allowed) from None
    if check is not None:
        check(stated)
    loaded = widened_area(stated)
    calibration_of(loaded)
    return loaded


def states_truth(scene: str | Path) -> bool:
    """Whether a scene, given as to `load_scene`, has a table `[truth]` of its own.

    Raises what `load_scene` does where there is none.
    """
    return "truth" in _content(scene)[1]


def scene_files(scene: str | Path, overrides: Overrides = (), profile: str | None = None) -> list[Path]:
    """The files that a scene, given as to `load_scene`, is made of: its own, the profile's, meshes and calibration.

    Raises what `load_scene` does for files that are not there or no TOML; nothing else is checked.
    """
    path, content = _content(scene, profile)
    content = _resolved(content, _pairs(overrides), path)
    files = [path, *([] if profile is None else [_locate_profile(profile)]), *_mesh_files(content.get("object"))]
    if isinstance(calibration := content.get("calibration"), str) and calibration:
        files.append(Path(calibration))
    return [file for file in files if file.is_file()]  # a random scene has no file of its own


def _content(scene: str | Path | Scene, profile: str | None = None) -> tuple[Path, dict[str, Any]]:
    """What relative files are resolved against, and the tables with a profile's over them."""
    if isinstance(scene, Scene):
        path, content = Path(scene.name or "scene"), scene_content(scene)
    elif (found := random_scene(str(scene))) is not None:
        path, content = Path(found["name"]), found
    else:
        path = _locate(scene)
        content = _parse(path)
    if profile is not None:
        _lay_over(content, _parse(_locate_profile(profile)))
    return path, content


def _stated(content: dict[str, Any], settings: list[tuple[str, str]], path: Path) -> Scene:
    """The scene of a file's content with settings on top."""
    return _validate(_resolved(content, settings, path))


def _resolved(content: dict[str, Any], settings: list[tuple[str, str]], path: Path) -> dict[str, Any]:
    """A file's content with settings on top, and with absolute paths."""
    content = deepcopy(content)
    given = content.get("calibration")
    for key, value in settings:
        _override(content, key, value)
    content.setdefault("name", path.stem)
    _resolve_meshes(content.get("object"), path, "object")
    _resolve_calibration(content, path.parent if content.get("calibration") == given else Path())
    return content


def _source(content: dict[str, Any], settings: list[tuple[str, str]], path: Path) -> str:
    """What made the scene wrong, by trial: the setting before which it was right, else the file.

    Tables are checked as a whole, so that the key that an error names is not always the one that was set.
    """
    for count in range(len(settings) - 1, -1, -1):
        try:
            _stated(content, settings[:count], path)
        except SceneError:
            continue
        return "--set {}={}".format(*settings[count])
    return path.name


def write_scene(scene: Scene, path: str | Path) -> None:
    """Write the scene with every value spelled out; loading it again gives an equal scene. Raises StorageError."""
    import tomli_w

    write_whole(Path(path), tomli_w.dumps(scene_content(scene)).encode())


def json_schema() -> dict[str, Any]:
    """JSON Schema of the scene file, for editors."""
    schema = Scene.model_json_schema(by_alias=True)
    for choice in ("StrategyTable", "ReconstructionTable"):
        schema["$defs"][choice]["additionalProperties"] = True
        schema["$defs"][choice]["properties"].pop("options")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def scene_content(scene: Scene) -> dict[str, Any]:
    """A scene as its file holds it, with every value spelled out; `Scene.model_validate` takes it back."""
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    for shape in content["object"]:
        _drop_inner_material(shape)
    return content


def _locate(name_or_path: str | Path) -> Path:
    given = str(name_or_path)
    if given in library.scene_names():
        return library.scene_path(given)
    path = Path(given)
    if isfile(path):
        return path
    if path.suffix or len(path.parts) > 1:
        raise SceneError("scene", given, "an existing scene file (.toml), or a name from `lwrprobe list scenes`")
    raise UnknownNameError("scene", given, library.scene_names())


def _locate_profile(name_or_path: str) -> Path:
    if name_or_path in library.profile_names():
        return library.profile_path(name_or_path)
    path = Path(name_or_path)
    if path.suffix == ".toml" and isfile(path):
        return path
    raise UnknownNameError("profile", name_or_path, library.profile_names())


def _lay_over(content: dict[str, Any], upper: Mapping[str, Any]) -> None:
    """Put a profile's values into a scene's tables, table by table."""
    for key, value in upper.items():
        if isinstance(value, Mapping) and isinstance(content.get(key), dict):
            _lay_over(content[key], value)
        else:
            content[key] = value


def _parse(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError(str(path), str(error), "a text file in TOML") from error


def _pairs(overrides: Overrides) -> list[tuple[str, str]]:
    if isinstance(overrides, Mapping):
        return [(str(key), _toml_text(value)) for key, value in overrides.items()]
    if isinstance(overrides, str):
        raise SceneError("override", overrides, "a list of such texts, or a dict of keys and values")
    pairs = []
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise SceneError("setting", text, "key=value, such as probe.radius=0.004")
        pairs.append((key.strip(), value.strip()))
    return pairs


def _toml_text(value: Any) -> str:
    """A plain value as TOML writes it; a text stays as it is."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, str | Path):
        return str(value)
    try:
        return json.dumps(value)
    except TypeError:
        return str(value)


def _override(content: dict[str, Any], key: str, text: str) -> None:
    *parents, last = key.split(".")
    place: Any = content
    for step in parents:
        place = place[_index(place, step, key)] if isinstance(place, list) else place.setdefault(step, {})
        if not isinstance(place, dict | list):
            raise SceneError(key, text, f"a key inside a table; {step!r} is a single value")
    if isinstance(place, list):
        place[_index(place, last, key)] = _toml_value(text)
    else:
        place[last] = _toml_value(text)


def _index(items: list, step: str, key: str) -> int:
    if not step.isdigit() or int(step) >= len(items):
        raise SceneError(key, step, f"an index below {len(items)}")
    return int(step)


def _toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError, RecursionError):
        return text


def _resolve_meshes(shapes: Any, path: Path, key: str) -> None:
    """Make mesh files absolute; what is no list of tables is left for the validator to refuse."""
    for n, shape in enumerate(shapes if isinstance(shapes, list) else []):
        if not isinstance(shape, dict):
            continue
        file = shape.get("file")
        if shape.get("shape") == "mesh" and isinstance(file, str) and file:
            shape["file"] = str((path.parent / file).resolve())
            if not isfile(shape["file"]):  # also where the name is longer than a system allows
                raise SceneError(f"{key}[{n}].file", file, "an existing mesh file")
        _resolve_meshes(shape.get("children"), path, f"{key}[{n}].children")


def _mesh_files(shapes: Any) -> Iterator[Path]:
    """Those that tables of shapes name, as `_resolve_meshes` left them."""
    for shape in shapes if isinstance(shapes, list) else []:
        if isinstance(shape, dict):
            if shape.get("shape") == "mesh" and isinstance(shape.get("file"), str):
                yield Path(shape["file"])
            yield from _mesh_files(shape.get("children"))


def _resolve_calibration(content: dict[str, Any], folder: Path) -> None:
    """Make the calibration's path absolute; a relative one is looked for in a folder."""
    file = content.get("calibration")
    if isinstance(file, str) and file:
        content["calibration"] = str((folder / file).resolve())
        if not isfile(content["calibration"]):
            raise SceneError("calibration", file, "an existing file written by `lwrprobe calibrate`")


def _drop_inner_material(shape: dict[str, Any]) -> None:
    for child in shape.get("children", ()):
        for key in MATERIAL:
            child.pop(key, None)
        _drop_inner_material(child)


def _validate(content: dict[str, Any]) -> Scene:
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        raise _scene_error(error) from None


def _scene_error(error: ValidationError) -> SceneError:
    """The first thing that is wrong, in the words of the file."""
    first = error.errors(include_url=False)[0]
    key, value, allowed = _key(first["loc"]), first["input"], _allowed(first)
    refusal = first.get("ctx", {}).get("error")
    if isinstance(refusal, Refusal):
        key, value, allowed = f"{key}.{refusal.key}" if key else refusal.key, refusal.value, refusal.allowed
    elif first["type"] == "missing" and isinstance(first["loc"][-1], str):
        value = "nothing"
    others = len({_key(one["loc"]) for one in error.errors()}) - 1
    if others:
        allowed += f" (and {others} more wrong)"
    return SceneError(key, value, allowed)


def _key(location: tuple) -> str:
    """`object[0].children[1].size`, without the tags that the validator puts between."""
    text = ""
    for i, step in enumerate(location):
        if isinstance(step, int):
            text += f"[{step}]"
        elif not _is_tag(location, i):
            text += f".{step}" if text else step
    return text


def _is_tag(location: tuple, i: int) -> bool:
    """Whether a step names the kind of a value and no key: a shape behind an index, a branch of `true | "auto"`."""
    step = location[i]
    return (step in SHAPES and i > 0 and isinstance(location[i - 1], int)) or step in ("bool", "literal['auto']")


_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "finite_number": "a finite number",
}


def _allowed(first: Mapping[str, Any]) -> str:
    kind, context, location = first["type"], first.get("ctx", {}), first["loc"]
    if kind == "extra_forbidden":
        return _known_keys(location)
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        tag = context.get("tag") or (first["input"].get("shape") if isinstance(first["input"], dict) else None)
        return f"shape = one of {', '.join(SHAPES)}{_near(tag, SHAPES)}"
    if kind == "value_error":
        return str(context["error"])
    if location == ("object",):
        return "tables headed [[object]], in double brackets"
    if location[-1] == "bool":
        return "true, false or 'auto'"
    if kind == "missing":
        return "the missing number" if isinstance(location[-1], int) else "a value; the key is missing"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        return f"{'at least' if kind == 'too_short' else 'at most'} {bound} items, not {context['actual_length']}"
    text = first["msg"][:1].lower() + first["msg"][1:]
    return _TYPES.get(kind, text.replace("input should be ", ""))


def _known_keys(location: tuple) -> str:
    """Names of the keys at the place of an unknown one, with the nearest."""
    model: Any = Scene
    for i, step in enumerate(location[:-1]):
        if _is_tag(location, i):
            model = _SHAPE_MODELS.get(step, model)
        elif isinstance(step, str):
            model = _field_model(model, step)
    keys = sorted(field.alias or name for name, field in model.model_fields.items())
    return f"one of the keys {', '.join(keys)}{_near(location[-1], keys)}"


def _field_model(model: Any, step: str) -> Any:
    field = next(f for name, f in model.model_fields.items() if step in (name, f.alias))
    inner = field.annotation
    for candidate in (inner, *get_args(inner)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return model


def _near(given: Any, known: Iterable[str]) -> str:
    near = nearest(given, known)
    return f" (did you mean {near!r}?)" if near else ""
