"""What holds for all tests: hypothesis draws the same examples each time, and which tests run side by side.

A file's tests stay together, since they share its fixtures. Those marked `realtime` stay together as well, so that no
two of them compete for the processor: sockets, signals and loops that keep up with a clock.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings
from hypothesis.internal.conjecture import providers

# There are as many test processes as cores: more threads in each of them spin beside one another, which multiplied the
# processor time of a decomposition by six. numpy reads these when it is loaded; what tests start inherits them.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# Hypothesis also draws constants that it reads in the source of loaded modules. What is loaded depends on which tests
# ran before, and reading takes seconds. A version without this function is not changed by the assignment.
providers._get_local_constants = lambda: providers._local_constants

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")

LEFT_OUT = re.compile(r"^pytestmark = .*pytest\.mark\.(slow|realtime)", re.MULTILINE)
"""In a file: all its tests are marked so."""


def pytest_addoption(parser):
    parser.addoption("--quick", action="store_true", help="leave out what is marked slow or realtime")


def pytest_ignore_collect(collection_path, config):
    """The quick path does not import files of which every test is left out: their imports take seconds."""
    if config.getoption("--quick") and collection_path.suffix == ".py" and LEFT_OUT.search(collection_path.read_text()):
        return True
    return None


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the groups
def pytest_collection_modifyitems(config, items):
    if config.getoption("--quick"):
        chosen = [item for item in items if not _marked(item, "slow") and not _marked(item, "realtime")]
        config.hook.pytest_deselected(items=[item for item in items if item not in set(chosen)])
        items[:] = chosen
    if hasattr(config, "workerinput"):
        _group(items)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory, request):
    """Gives the folder of a name that `make(folder)` fills, once for all processes; nobody changes it afterwards."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if hasattr(request.config, "workerinput") else base

    def folder_of(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = base / name, base / f"{name}.done"
        with FileLock(base / f"{name}.lock"):
            if not done.exists():
                make(folder)
                done.touch()
        return folder

    return folder_of


@pytest.fixture(scope="session")
def upper_edge() -> dict:
    """Settings of a short run: half of the upper edge of the upright cylinder, with a piece of its wall."""
    area = {"area.lower": [-0.012, 0.0, 0.030], "area.upper": [0.012, 0.045, 0.058]}
    return {**area, "strategy.step": 0.03, "truth.profile": "ideal"}


@pytest.fixture(scope="session")
def recorded_cylinder(made_once, upper_edge) -> Path:
    """The folder of a short run with a bag, of five lines, in a world that is known."""
    import lwrprobe as lp

    settings = {**upper_edge, "strategy.step": 0.006, "uncertainty.profile": "ideal"}

    return made_once(
        "recorded_cylinder",
        lambda folder: lp.explore(
            "cylinder_vertical", seed=5, settings=settings, out=folder, record=True, progress=False
        ),
    )


def _group(items):
    """One group a file and one of `realtime`; that one first, since it mostly waits, then those with slow tests."""
    names = {item: "realtime" if _marked(item, "realtime") else item.path.name for item in items}
    slow = {name for item, name in names.items() if _marked(item, "slow")}
    items.sort(key=lambda item: (names[item] != "realtime", names[item] not in slow))
    for item in items:
        item.add_marker(pytest.mark.xdist_group(names[item]))


def _marked(item, name):
    return item.get_closest_marker(name) is not None
