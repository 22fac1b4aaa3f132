"""Kernels on disk: several cold processes at once, unchanged code, changed callees; and how kernels are compiled."""

import gc
import json
import os
import subprocess
import sys
import textwrap

import pytest
from filelock import FileLock

from lwrprobe.compiled import disk_cache
from lwrprobe.compiled.disk_cache import IndexFile

pytestmark = pytest.mark.slow

CALLEE = """
from lwrprobe.compiled import allocation_free_kernel

@allocation_free_kernel
def weighted(a, b, weight):
    return a + weight * b
"""

CALLER = """
from callee_kernels import weighted
from lwrprobe.compiled import kernel

@kernel
def total(values, weight):
    sum = weighted(0.0, 0.0, 1)
    for value in values.flat:
        sum = weighted(sum, value, weight)
        sum = weighted(sum, value, 2)
    return sum
"""

PROCESS = """
import json, random, sys
import numpy as np
from caller_kernels import total
import lwrprobe.compiled.pipeline as pipeline

compiled = []
cases = [(kind, shape, weight) for kind in ("f8", "i4") for shape in (4, (2, 2)) for weight in (1, 0.5)]
random.Random(int(sys.argv[1])).shuffle(cases)
got = {}
with pipeline.on_compilation(compiled.append):
    for kind, shape, weight in cases:
        got[repr((kind, shape, weight))] = float(total(np.arange(4, dtype=kind).reshape(shape), weight))
print(json.dumps({"got": got, "compiled": len(compiled)}))
"""


WRITER = """
import sys, time
from pathlib import Path
from lwrprobe.compiled.disk_cache import IndexFile

folder, me = Path(sys.argv[1]), int(sys.argv[2])
index = IndexFile(str(folder), "kernel", "stamp")
Path(folder, f"ready{me}").touch()
while len(list(folder.glob("ready*"))) < 4:
    time.sleep(0.001)
for k in range(40):
    index.save((me, k), (me, k))
    found = index.load((me, k))
    assert found == (me, k), f"saved {(me, k)}, found {found}"
"""

INTERRUPTED = """
import signal
import numpy as np
from llvmlite.binding import ffi
from caller_kernels import total

close = ffi.OutputString.close

def interrupted_close(self):
    if self._ptr is not None:
        if self._owned:
            ffi.lib.LLVMPY_DisposeString(self._ptr)
            signal.raise_signal(signal.SIGINT)
        self._ptr = None
        del self._as_parameter_

ffi.OutputString.close = interrupted_close
signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in what a shell has put into the background
try:
    total(np.arange(4.0), 1.0)
except KeyboardInterrupt:
    print("interrupted")
ffi.OutputString.close = close
print(total(np.arange(4.0), 1.0))
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "callee_kernels.py").write_text(textwrap.dedent(CALLEE))
    (tmp_path / "caller_kernels.py").write_text(textwrap.dedent(CALLER))
    return tmp_path


def start(folder, seed, program=PROCESS):
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    return subprocess.Popen(
        [sys.executable, "-c", program, str(seed)],
        env=environment, cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def result(process):
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    return json.loads(out)


def expected():
    """The numbers that Python computes: the sum of 0 to 3 is 6, with the weights `weight` and 2."""
    kinds, shapes, weights = ("f8", "i4"), (4, (2, 2)), (1, 0.5)
    return {repr((k, s, w)): 6.0 * (w + 2) for k in kinds for s in shapes for w in weights}


def test_entries_saved_at_once_by_several_processes_keep_their_keys(tmp_path):
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), str(me)], text=True, stderr=subprocess.PIPE)
        for me in range(4)
    ]
    for writer in writers:
        assert (writer.communicate(timeout=300)[1], writer.returncode) == ("", 0)
    index = IndexFile(str(tmp_path), "kernel", "stamp")
    for key in ((me, k) for me in range(4) for k in range(40)):
        assert index.load(key) == key


def test_cold_processes_at_once_leave_a_cache_that_is_right(folder):
    for process in [start(folder, seed) for seed in range(4)]:
        assert result(process)["got"] == expected()
    warm = result(start(folder, 9))
    assert warm["got"] == expected()
    assert warm["compiled"] == 0


def test_a_new_time_compiles_nothing_and_new_content_compiles_the_callers(folder):
    assert result(start(folder, 0))["compiled"] > 0
    for name in ("callee_kernels.py", "caller_kernels.py"):
        os.utime(folder / name, (1, 1))
    assert result(start(folder, 0))["compiled"] == 0
    (folder / "callee_kernels.py").write_text(textwrap.dedent(CALLEE).replace("a + weight", "a - weight"))
    changed = result(start(folder, 0))
    assert changed["compiled"] > 0
    assert changed["got"] == {case: -value for case, value in expected().items()}


@pytest.mark.parametrize("cached", [False, True])
def test_an_interrupt_waits_until_llvmlite_has_noted_what_it_has_freed(folder, cached):
    if cached:
        result(start(folder, 1))
    process = start(folder, 1, INTERRUPTED)
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    assert out.split() == ["interrupted", "18.0"]


def test_callees_are_compiled_for_types_and_not_for_literals(folder, monkeypatch):
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr("numba.config.CACHE_DIR", str(folder / "cache"))
    import numpy as np
    from caller_kernels import total

    from lwrprobe.compiled import pipeline

    assert gc.isenabled()
    names = []
    with pipeline.on_compilation(names.append):
        assert total(np.array([1.0, 2.0]), 3) == 15.0
    assert gc.isenabled()
    assert sorted(names) == ["total", "weighted.inner"]


def test_a_lock_that_is_never_given_back_costs_a_compilation_and_no_hang(tmp_path, monkeypatch):
    monkeypatch.setattr(disk_cache, "MAX_WAIT", 0.05)
    index = IndexFile(str(tmp_path), "kernel", 1)
    index.save("key", b"code")
    assert index.load("key") == b"code"
    with FileLock(tmp_path / disk_cache.LOCK_NAME, is_singleton=False):
        assert index.load("key") is None
        index.save("other", b"code")
    assert index.load("key") == b"code"
    assert index.load("other") is None


def test_without_locks_of_the_system_a_file_left_behind_stops_nobody(tmp_path, monkeypatch):
    monkeypatch.setattr(disk_cache, "FileLock", disk_cache.SoftFileLock)
    (tmp_path / disk_cache.LOCK_NAME).touch()
    index = IndexFile(str(tmp_path), "kernel", 1)
    index.save("key", b"code")
    assert index.load("key") == b"code"


def test_a_forked_process_takes_locks_of_its_own(tmp_path):
    index = IndexFile(str(tmp_path), "kernel", 1)
    index.save("key", b"code")
    child = os.fork() if hasattr(os, "fork") else None
    if child is None:
        return  # there is nothing to inherit a lock by
    if not child:
        os._exit(0 if index.load("key") == b"code" else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
