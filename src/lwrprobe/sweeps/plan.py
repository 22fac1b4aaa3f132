"""What a sweep consists of: the file `lwrprobe sweep` reads, and the tasks it stands for."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lwrprobe import __version__
from lwrprobe.errors import InputError, LwrprobeError, SceneError

MAX_RUNS = 1_000_000

Names = Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)]


class Variant(BaseModel):
    """One set of settings that every scene is explored with."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: str = Field(min_length=1)
    set: list[str] = []
    """`key=value` of the scene file."""


class SweepFile(BaseModel):
    """A sweep file: every scene with every strategy, profile, variant and seed."""

    model_config = ConfigDict(extra="forbid", strict=True)

    scenes: Names
    """Built-in names, or scene files as seen from the sweep file."""
    strategies: Names = ["grid_version"]
    profiles: Names = ["none"]
    """Settings put over the scene's own: built-in names, or files as seen from the sweep file; `none` leaves them."""
    seeds: int | list[int] = 1
    """How many, from 1 on, or which."""
    set: list[str] = []
    """`key=value`, of all runs."""
    variant: list[Variant] = []


@dataclass(slots=True, frozen=True)
class SweepTask:
    """One exploration; all of it is text and numbers, so that it can be sent anywhere.

    Attributes
    ----------
    scene, strategy, profile, variant, seed : what the row is called
    settings : `key=value` in their order
    content : digest of the files that the scene is made of
    """

    scene: str
    strategy: str
    profile: str
    variant: str
    seed: int
    settings: tuple[str, ...] = ()
    content: str = ""

    @property
    def key(self) -> str:
        """Tells the task from all others of this version of the library."""
        text = json.dumps([__version__, asdict(self)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def for_worker(self) -> dict[str, Any]:
        """As `lwrprobe.sweeps.worker` takes it."""
        given = [*self.settings, f"strategy.name={json.dumps(self.strategy)}", f"run.seed={self.seed}"]
        return {"scene": self.scene, "set": given, "profile": _profile(self.profile)}

    def named(self) -> dict[str, Any]:
        """The columns that name a row."""
        names = ("scene", "strategy", "profile", "variant", "seed")
        return {name: getattr(self, name) for name in names}


def read_plan(file: str | Path) -> list[SweepTask]:
    """The tasks of a sweep file, in the order of its lists.

    Raises SceneError naming the file and the key for wrong content; scenes and settings are checked by the runs.
    """
    path = Path(file)
    try:
        plan = SweepFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise SceneError("file", str(path), f"a file that can be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError("file", str(path), f"TOML ({error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SceneError(f"{path.name}: {key}", first.get("input"), first["msg"]) from None
    seeds: Sequence[int] = range(1, plan.seeds + 1) if isinstance(plan.seeds, int) else plan.seeds
    if not seeds or (isinstance(seeds, list) and min(seeds) < 0):
        raise SceneError(f"{path.name}: seeds", plan.seeds, "how many, or a list of seeds of 0 or more")
    variants = plan.variant or [Variant(name="as is")]
    names = [variant.name for variant in variants]
    if len(set(names)) < len(names):
        raise SceneError(f"{path.name}: variant", names, "different names")
    count = len(plan.scenes) * len(plan.strategies) * len(plan.profiles) * len(variants) * len(seeds)
    if count > MAX_RUNS:
        raise SceneError(f"{path.name}", f"{count} runs", f"at most {MAX_RUNS}")
    scenes, profiles = ([_resolved(name, path.parent) for name in names] for names in (plan.scenes, plan.profiles))
    settings = {variant.name: (*plan.set, *variant.set) for variant in variants}
    content = {kind: _content(kind[0], kind[1], settings[kind[2]]) for kind in product(scenes, profiles, settings)}
    return [
        SweepTask(scene, strategy, profile, variant, seed, settings[variant], content[scene, profile, variant])
        for scene, strategy, profile, variant, seed in product(scenes, plan.strategies, profiles, settings, seeds)
    ]


def check_scenes(tasks: Sequence[SweepTask]) -> None:
    """Raise the first error of a scene, a profile or a setting, before any of the runs begins."""
    from lwrprobe.scene import load_scene

    seen = set()
    for task in tasks:
        kind = (task.scene, task.profile, task.settings)
        if kind not in seen:
            seen.add(kind)
            given = task.for_worker()
            try:
                load_scene(given["scene"], given["set"], given["profile"])
            except InputError as error:
                error.args = (f"{task.scene}, variant {task.variant!r}: {error}",)
                raise


def _resolved(name: str, folder: Path) -> str:
    """A scene or a profile, as a path where it is a file as seen from the sweep file."""
    file = folder / name
    return str(file.resolve()) if file.suffix == ".toml" and isfile(file) else name


def _content(scene: str, profile: str, settings: Sequence[str]) -> str:
    """Digest of all files that a scene is made of: with other content the task is another."""
    from lwrprobe.scene.scene_file import scene_files

    try:
        digests = [hashlib.sha256(file.read_bytes()) for file in scene_files(scene, settings, _profile(profile))]
    except (LwrprobeError, OSError):  # `check_scenes` says what is wrong
        return ""
    return hashlib.sha256(b"".join(digest.digest() for digest in digests)).hexdigest()


def _profile(name: str) -> str | None:
    """As `load_scene` takes it."""
    return None if name == "none" else name
