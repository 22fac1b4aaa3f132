#!/usr/bin/env python3
"""For which systems and Pythons every dependency can be installed as a wheel, at its version in constraints.txt.

python3 scripts/check_wheels.py                     all of them; a run of a few minutes
python3 scripts/check_wheels.py win_amd64 3.14      one of them

Only metadata is read, nothing is installed. Exit code 1 where a wheel is missing.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib

import environment

SYSTEMS = {
    "Linux x86_64": "manylinux_2_28_x86_64",
    "Linux arm64": "manylinux_2_28_aarch64",
    "macOS arm64": "macosx_14_0_arm64",
    "macOS x86_64": "macosx_14_0_x86_64",
    "Windows x64": "win_amd64",
}
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
OLDER = {
    "manylinux_2_28": ("manylinux_2_27", "manylinux_2_26", "manylinux_2_24", "manylinux_2_17", "manylinux2014"),
    "macosx_14_0": ("macosx_13_0", "macosx_12_0", "macosx_11_0", "macosx_10_9"),
}
"""What a wheel may be built for and still be installed: pip takes a list, and derives none from a name."""


def main() -> None:
    systems = {name: tag for name, tag in SYSTEMS.items() if not sys.argv[1:] or tag in sys.argv[1:]}
    pythons = [version for version in PYTHONS if not sys.argv[2:] or version in sys.argv[2:]]
    environment.ensure()
    lacking = 0
    for name, tag in systems.items():
        for version in pythons:
            missing = without_wheel(dependencies(), tag, version)
            found = f"no wheel of {', '.join(missing)}" if missing else "complete"
            print(f"{name:<14} Python {version}  {found}", flush=True)
            lacking += len(missing)
    sys.exit(1 if lacking else 0)


def dependencies() -> list[str]:
    """Names from pyproject.toml, without those that a marker leaves out on some systems, and numba's own compiler."""
    project = tomllib.loads((environment.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = [re.split(r"[<>=; \[]", text)[0] for text in project["dependencies"] if ";" not in text]
    return [*names, "llvmlite", "pydantic_core", "contourpy", "kiwisolver", "rtb-data", "spatialgeometry"]


def pinned(package: str) -> str:
    for line in (environment.ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines():
        if plain(line.partition("==")[0]) == plain(package):
            return line.strip()
    sys.exit(f"constraints.txt has no version of {package}")


def without_wheel(packages: list[str], tag: str, version: str) -> list[str]:
    """Those that have no wheel; pip names one at a time, and is asked for the rest again."""
    missing: list[str] = []
    while True:
        sought = [package for package in packages if package not in missing]
        error = asked_for(sought, tag, version)
        if not error:
            return missing
        named = re.search(r"No matching distribution found for ([\w.-]+)==", error)
        lacking = [package for package in sought if named and plain(package) == plain(named[1])]
        if not lacking:
            sys.exit(error)
        missing += lacking


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def asked_for(packages: list[str], tag: str, version: str) -> str:
    """pip's error when it is asked for wheels for another system than this one; empty when there is each."""
    base = next((base for base in OLDER if tag.startswith(base)), None)
    tags = [tag] if base is None else [tag, *(tag.replace(base, older, 1) for older in OLDER[base])]
    command = [str(environment.PYTHON), "-m", "pip", "install", "--quiet", "--dry-run", "--no-deps"]
    command += ["--ignore-installed", "--only-binary", ":all:", "--implementation", "cp", "--python-version", version]
    command += ["--target", str(environment.VENV / "nowhere")]
    command += [option for one in tags for option in ("--platform", one)]
    if base and base.startswith("macosx"):
        command += ["--platform", tag.replace("arm64", "universal2").replace("x86_64", "universal2")]
        command += ["--platform", "macosx_10_9_universal2"]
    done = subprocess.run([*command, *map(pinned, packages)], capture_output=True, text=True)
    return done.stderr if done.returncode else ""


if __name__ == "__main__":
    main()
