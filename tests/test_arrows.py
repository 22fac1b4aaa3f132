"""The arrows between the packages point one way (docs/architecture.md)."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = ROOT / "src" / "lwrprobe"

LEVELS = [
    {"errors", "lazy"},
    {"contracts"},
    {"bags", "compiled", "host"},
    {"control", "kinematics", "trajectory"},
    {"contact", "mapping"},
    {"calibration", "collision", "reconstruction"},
    {"scene"},
    {"evaluation"},
    {"exploration"},
    {"runs"},
    {"sweeps", "views"},
    {"bench"},
    {"cli"},
]
"""From the ground up; a package imports from the levels below it, never from another one of its own level."""

PLUGINS = {
    "drivers/lwrprobe_sim": {"contracts", "compiled", "kinematics", "scene"},
    "drivers/lwrprobe_fri": {"contracts", "compiled", "host"},
    "drivers/lwrprobe_ati": {"contracts", "compiled", "host", "scene"},
    "drivers/lwrprobe_rig": {"cli", "contracts", "host", "scene"},
    "drivers/lwrprobe_mujoco": {"contracts", "kinematics", "scene"},
    "strategies/lwrprobe_strategies": {"contracts", "control", "mapping"},
}
"""Which packages of the library each plug-in may know."""


@cache
def imported(file: Path) -> set[str]:
    """Full names of all modules that a file imports, wherever in it the import stands."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative imports hide the arrow"
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def packages_of(names: set[str]) -> set[str]:
    known = set().union(*LEVELS)
    return {name.split(".")[1] for name in names if name.startswith("lwrprobe.") and name.split(".")[1] in known}


def level(package: str) -> int:
    return next(i for i, packages in enumerate(LEVELS) if package in packages)


def test_every_package_has_its_level():
    found = {p.stem for p in LIBRARY.iterdir() if p.name not in ("__init__.py", "__pycache__", "py.typed")}
    assert found == set().union(*LEVELS)


@pytest.mark.parametrize("package", sorted(set().union(*LEVELS)))
def test_package_imports_only_from_below(package):
    place = LIBRARY / package
    files = sorted(place.rglob("*.py")) if place.is_dir() else [LIBRARY / f"{package}.py"]
    assert files
    for file in files:
        for other in packages_of(imported(file)) - {package}:
            assert level(other) < level(package), f"{file.relative_to(ROOT)} imports {other}"


def test_library_knows_no_plugin_by_name():
    for file in LIBRARY.rglob("*.py"):
        bad = [name for name in imported(file) if name.startswith("lwrprobe_")]
        assert not bad, f"{file.relative_to(ROOT)} imports {bad}; plug-ins are found by entry point"


@pytest.mark.parametrize("plugin", PLUGINS)
def test_plugin_knows_only_its_rooms(plugin):
    for file in sorted((ROOT / plugin).rglob("*.py")):
        names = imported(file)
        assert packages_of(names) <= PLUGINS[plugin], f"{file.relative_to(ROOT)}: {packages_of(names)}"
        own = Path(plugin).name
        # Emulators stand on lwrprobe_rig: the faulty line, the loop, the operator's console.
        ground = {"lwrprobe_rig"} if "emulator" in file.parts else set()
        # MuJoCo's world has its own physics, and the sensor's faults and the truth of the simulator.
        ground |= {"lwrprobe_sim"} if own == "lwrprobe_mujoco" else set()
        others = {name.split(".")[0] for name in names if name.startswith("lwrprobe_")} - {own} - ground
        assert not others, f"{file.relative_to(ROOT)} imports another plug-in: {others}"


@pytest.mark.parametrize(
    ("part", "below"),
    [("planning", {"coverage_config"}), ("tip.py", {"planning", "trace"}), ("skills", {"outcomes", "planning", "tip"})],
)
def test_planning_and_skills_know_no_strategy(part, below):
    place = ROOT / "strategies" / "lwrprobe_strategies" / part
    for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
        parts = {name.split(".")[1] for name in imported(file) if name.startswith("lwrprobe_strategies.")}
        assert parts - {place.stem} <= below, f"{file.relative_to(ROOT)} imports {parts}"


def test_numba_kernels_live_in_kernel_files():
    for root in (LIBRARY, ROOT / "drivers", ROOT / "strategies"):
        for file in root.rglob("*.py"):
            names = imported(file)
            assert "numba.njit" not in names, f"{file}: use lwrprobe.compiled.kernel"
            if "lwrprobe.compiled.kernel" in names:
                assert "kernels" in file.name, f"{file.relative_to(ROOT)}: kernels live in files named so"


def test_every_folder_of_modules_is_a_package():
    files = [file for top in ("src", "drivers", "strategies") for file in (ROOT / top).rglob("*.py")]
    assert len(files) > 300
    assert not {file.parent for file in files if not (file.parent / "__init__.py").is_file()}
