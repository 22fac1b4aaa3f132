"""The readers fed by atheris, which keeps the inputs that reach new lines (`pip install atheris`; Linux).

`python tests/hostile/guided.py SECONDS` takes each reader in turn, in a process of its own, for its share of the time,
and prints what it counted; inputs that are not refused with a typed error are kept in `tests/hostile/broken`.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
import time
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import lwrprobe

_SLOW = 60
"""s by the clock an input may take at most; `outcome` counts the computing time."""
_EVERY = 1.0
"""s between two notes of the counts: libFuzzer ends the process without a last word."""
_LARGEST = 8192
"""Bytes of an input."""


def fuzz(seconds: float, seed: int) -> dict[str, Counter[str]]:
    """All readers, each for its share of the time; what came of their inputs."""
    from readers import READERS

    share, found = max(2, round(seconds / len(READERS))), {}
    for name in READERS:
        with TemporaryDirectory() as folder:
            command = [sys.executable, __file__, name, str(share), str(seed), folder]
            done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            notes = Path(folder) / "counts.json"
            found[name] = Counter(json.loads(notes.read_text())) if notes.is_file() else Counter()
            if done.returncode:
                found[name]["crashed"] += 1
                _keep_crash(name, Path(folder), done.stderr)
    return found


def _keep_crash(name: str, folder: Path, said: str) -> None:
    """An input that ended the process itself, or took too long: libFuzzer writes it into the working folder."""
    from readers import BROKEN

    print(f"{name}: the process ended: {said[-2000:]}", flush=True)
    for kind in ("crash", "timeout", "oom"):
        for left in folder.glob(f"{kind}-*"):
            (BROKEN / f"{kind}{left.name[-6:]}_{name}").write_bytes(left.read_bytes())


def fuzz_one(name: str, seconds: int, seed: int, folder: Path) -> None:
    """One reader; does not return."""
    import atheris

    # numba cannot compile a kernel with what atheris puts into each branch
    kernels = [
        ".".join(file.relative_to(root.parent).with_suffix("").parts)
        for root in map(Path, lwrprobe.__path__)
        for file in root.rglob("*kernels*.py")
    ]
    with atheris.instrument_imports(
        include=["lwrprobe", "lwrprobe_ati", "mcap", "rosbags", "trimesh", "tomllib", "json"],
        exclude=[*kernels, "lwrprobe.compiled"],
    ):
        from readers import BROKEN, outcome, well_formed

    corpus, notes, counts = folder / "corpus", folder / "counts.json", Counter[str]()
    corpus.mkdir()
    for number, content in enumerate(well_formed(folder)[name]):
        (corpus / f"well_formed_{number}").write_bytes(content)
        assert outcome(name, content, folder) in ("read", "refused")  # kernels are compiled here
    seen: set[str] = set()
    noted = 0.0

    def test(data: bytes) -> None:
        nonlocal noted
        found = outcome(name, data, folder)
        if found not in ("read", "refused"):
            if found not in seen:
                seen.add(found)
                (BROKEN / f"guided{seed}{len(seen)}_{name}").write_bytes(data)
                print(f"{name}: {found}", file=sys.stderr, flush=True)
            found = "failed"
        counts[found] += 1
        if time.monotonic() > noted + _EVERY:
            noted = time.monotonic()
            notes.write_text(json.dumps(counts))

    notes.write_text("{}")
    options = [
        f"-max_total_time={seconds}", f"-timeout={_SLOW}", f"-max_len={_LARGEST}", f"-seed={seed}", "-rss_limit_mb=0",
        f"-artifact_prefix={folder}/", str(corpus),
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *options], test)
    atheris.Fuzz()


if __name__ == "__main__":
    if find_spec("atheris") is None:
        raise SystemExit("atheris is not installed; pip install atheris")
    if len(sys.argv) == 5:
        fuzz_one(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
    counted = fuzz(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else random.randrange(1000))
    for name, count in counted.items():
        print(f"{name:<18}", ", ".join(f"{what} {count[what]}" for what in ("read", "refused", "failed", "crashed")))
    print("in all", sum(count.total() for count in counted.values()))
