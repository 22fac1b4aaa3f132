"""`import lwrprobe` is light: what is heavy is loaded when it is first used."""

import json
import subprocess
import sys

import pytest

import lwrprobe as lp

HEAVY = {"numpy", "scipy", "numba", "matplotlib", "trimesh", "rich", "pydantic", "roboticstoolbox", "IPython", "typer"}


def loaded_by(code: str) -> set[str]:
    """Top-level names of what a fresh interpreter has loaded after some lines."""
    lines = f"{code}\nimport json, sys\nprint(json.dumps(sorted({{name.split('.')[0] for name in sys.modules}})))"
    found = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    return set(json.loads(found.stdout.splitlines()[-1]))


def test_the_package_loads_nothing_heavy():
    assert not loaded_by("import lwrprobe") & HEAVY


def test_its_import_takes_less_than_three_tenths_of_a_second():
    found = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", "import lwrprobe"], capture_output=True, text=True, check=True
    )
    rows = [line.split("|") for line in found.stderr.splitlines() if line.endswith(" lwrprobe")]
    assert len(rows) == 1
    assert int(rows[0][1]) < 300_000


@pytest.mark.slow
def test_a_scene_is_loaded_without_kernels_and_pictures():
    assert not loaded_by("import lwrprobe as lp; lp.load_scene('block')") & {"matplotlib", "trimesh", "rich", "typer"}


@pytest.mark.parametrize("name", sorted(lp.__all__))
def test_every_name_is_there_and_has_a_docstring(name):
    assert name in dir(lp)
    value = getattr(lp, name)
    assert value.__doc__
    assert getattr(lp, name) is value


def test_what_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'explor'"):
        _ = lp.explor
