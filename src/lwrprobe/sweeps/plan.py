"""What a sweep consists of: the file `lwrprobe sweep` reads, and the tasks it stands for."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lwrprobe import __version__
from lwrprobe.errors import InputError, SceneError

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
    """Settings put over the scene's own; `none` leaves them."""
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
    """

    scene: str
    strategy: str
    profile: str
    variant: str
    seed: int
    settings: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Tells the task from all others of this version of the library."""
        text = json.dumps([__version__, asdict(self), _content(self.scene)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def for_worker(self) -> dict[str, Any]:
        """As `lwrprobe.sweeps.worker` takes it."""
        given = [*self.settings, f"strategy.name={json.dumps(self.strategy)}", f"run.seed={self.seed}"]
        return {"scene": self.scene, "set": given, "profile": None if self.profile == "none" else self.profile}

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
    scenes = [_resolved(scene, path.parent) for scene in plan.scenes]
    return [
        SweepTask(scene, strategy, profile, variant.name, seed, (*plan.set, *variant.set))
        for scene, strategy, profile, variant, seed in product(scenes, plan.strategies, plan.profiles, variants, seeds)
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


def _resolved(scene: str, folder: Path) -> str:
    file = folder / scene
    return str(file.resolve()) if file.suffix == ".toml" and file.is_file() else scene


def _content(scene: str) -> str:
    """A scene file's text: with another one the task is another."""
    path = Path(scene)
    return path.read_text(encoding="utf-8") if path.suffix == ".toml" and path.is_file() else ""
