"""What `lwrprobe ARGUMENTS` answers, asked in this process: a process of its own takes a second to start."""

from __future__ import annotations

import io
import os
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from lwrprobe.cli.app import main


@dataclass(slots=True, frozen=True)
class Answer:
    """Exit code and what was printed."""

    returncode: int
    stdout: str
    stderr: str


def ask(*arguments: object, folder: Path | None = None, **variables: str) -> Answer:
    """Run the command in `folder`, with these environment variables besides those that are set."""
    out, error = io.StringIO(), io.StringIO()
    with (
        patch.object(sys, "argv", ["lwrprobe", *map(str, arguments)]),
        patch.object(sys.modules["__main__"], "__package__", None),  # `python -m pytest` would be the program's name
        patch.dict(os.environ, variables),
        chdir(folder or Path.cwd()),
        redirect_stdout(out),
        redirect_stderr(error),
    ):
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
    return Answer(code, out.getvalue(), error.getvalue())
