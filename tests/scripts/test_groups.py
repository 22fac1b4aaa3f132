"""Which tests run in one process: those of a file, and all that keep up with a clock."""

import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TESTS = """
import os
import pytest

@pytest.fixture(autouse=True)
def note(request):
    kind = "realtime" if request.node.get_closest_marker("realtime") else request.node.path.stem
    with open(os.environ["NOTES"], "a") as notes:
        print(kind, os.environ["PYTEST_XDIST_WORKER"], file=notes)

@pytest.mark.parametrize("k", range(6))
def test_plain(k):
    pass

@pytest.mark.realtime
@pytest.mark.parametrize("k", range(3))
def test_with_a_clock(k):
    pass
"""


@pytest.mark.slow
def test_a_file_and_what_keeps_up_with_a_clock_stay_in_one_process(tmp_path):
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    for name in ("one", "two", "three", "four"):
        (tmp_path / f"test_{name}.py").write_text(TESTS)
    notes = tmp_path / "notes"
    side_by_side = ["-n", "2", "--dist", "loadgroup", "--no-loadscope-reorder", "-p", "no:cacheprovider"]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *side_by_side, str(tmp_path)],
        cwd=tmp_path, env=environment | {"NOTES": str(notes)}, capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    workers = defaultdict(set)
    for line in notes.read_text().splitlines():
        kind, worker = line.split()
        workers[kind].add(worker)
    assert set(workers) == {"realtime", "test_one", "test_two", "test_three", "test_four"}
    assert all(len(group) == 1 for group in workers.values()), dict(workers)
