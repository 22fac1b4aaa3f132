"""The fenced blocks of a Markdown page, and how each kind is carried out.

| fence | what is done |
|---|---|
| python | runs, after the blocks before it on the same page |
| python file=NAME, toml file=NAME | is written to NAME, for the blocks below it |
| bash | each line runs: `lwrprobe` in this process, `pip install FOLDER` as an entry on the import path |
| bash parse-only | commands, options and settings are checked, nothing runs: it needs a device or a long time |
| toml | is read |
| text output | has to be what the block before it printed; `...` stands for anything |
| text | is not looked at |
"""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import shlex
import sys
import tomllib
import types
from dataclasses import dataclass
from pathlib import Path

import typer
from typer.testing import CliRunner

from lwrprobe.cli.app import app
from lwrprobe.contracts.plugins import load, names
from lwrprobe.scene import load_scene

ROOT = Path(__file__).resolve().parents[2]
_FOLDERS = ".", "docs", "docs/how-to", "docs/explanation", "docs/reference", "examples/*"
PAGES = [page for folder in _FOLDERS for page in sorted(ROOT.glob(f"{folder}/*.md"))]
_FENCE = re.compile(r"^```(\w*) ?([^\n`]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_WORDS = {"python": r"|file=\S+", "toml": r"|file=\S+", "bash": r"|parse-only", "text": r"|output"}
_RUN = "scripts/run.py"


@dataclass(slots=True, frozen=True)
class Block:
    """One fenced block: the line it stands on, its language, the word behind that, its text."""

    line: int
    language: str
    word: str
    text: str


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page in order; raises ValueError for a language or word that is not known."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        language, word = match[1], match[2].strip()
        if language == "" and word.startswith("{"):  # a directive of the site: a toctree, an image
            continue
        if language not in _WORDS or not re.fullmatch(_WORDS[language], word):
            raise ValueError(f"{page.name}:{line}: block {language!r} {word!r}; known: {_WORDS}")
        found.append(Block(line, language, word, match[3]))
    return found


class PageRunner:
    """Carries out the blocks of one page, in the current folder."""

    def __init__(self) -> None:
        self.module = types.ModuleType("page")
        self.printed = ""

    def run(self, block: Block) -> None:
        """Carry one block out; raises AssertionError, or what the block raises."""
        if block.word.startswith("file="):
            path = Path(block.word.removeprefix("file="))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            self._python(block)
        elif block.language == "toml":
            tomllib.loads(block.text)
        elif block.language == "bash":
            work = check_line if block.word else self._shell
            for line in lines(block.text):
                work(line)
        elif block.word == "output":
            flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
            same = doctest.OutputChecker().check_output(block.text, self.printed, flags)
            assert same, f"the page says\n{block.text}\nbut printed was\n{self.printed}"

    def _python(self, block: Block) -> None:
        sys.modules["page"] = self.module  # dataclasses look their module up
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(block.text, f"block in line {block.line}", "exec"), self.module.__dict__)
        self.printed = out.getvalue()

    def _shell(self, words: list[str]) -> None:
        program, *arguments = words
        if words[:2] == ["python3", _RUN]:
            program, arguments = "lwrprobe", words[2:]
        if words[:2] == ["pip", "install"]:
            assert "/" in words[2], f"{words[2]}: pip would take this name from the package index"
            install(words[2])
        elif program == "python3" and arguments[0].endswith(".py"):
            path = Path(arguments[0]) if Path(arguments[0]).is_file() else ROOT / arguments[0]
            self._python(Block(1, "python", "", path.read_text(encoding="utf-8")))
        elif program == "lwrprobe":
            done = CliRunner().invoke(app, arguments)
            assert done.exit_code == 0, f"{shlex.join(words)}: {done.exception!r}\n{done.output}"
            self.printed = done.stdout
        else:
            raise AssertionError(f"{shlex.join(words)}: a command that the tests do not know")


def lines(text: str) -> list[list[str]]:
    """The commands of a shell block, each as its words; comments and empty lines are left out."""
    joined = text.replace("\\\n", " ")
    return [words for words in (shlex.split(line, comments=True) for line in joined.splitlines()) if words]


def check_line(words: list[str]) -> None:
    """Check a command without running it: program, subcommand, options, scene and settings."""
    if words[0] == "python3":
        assert (ROOT / words[1]).is_file(), f"{words[1]}: no such file"
        if words[1] == _RUN:
            check_line(["lwrprobe", *words[2:]])
        return
    if words[:2] == ["pip", "install"]:
        check_requirement(words[2])
        return
    assert Path(words[0]).name == "lwrprobe", f"{shlex.join(words)}: a command that the tests do not know"
    if words[1] == "emulate":
        check_emulator(*words[2:])
        return
    command, arguments = typer.main.get_command(app), words[1:]
    while hasattr(command, "commands"):
        assert arguments[0] in command.commands, f"{shlex.join(words)}: no command {arguments[0]!r}"
        command, arguments = command.commands[arguments[0]], arguments[1:]
    given = command.make_context(command.name, list(arguments)).params
    if given.get("scene") is not None and not str(given["scene"]).startswith("my_"):
        load_scene(given["scene"], given.get("settings") or [], given.get("profile"))
    kinds = {"strategy": "strategy", "arm": "driver", "sensor": "driver", "method": "reconstructor"}
    for option, kind in kinds.items():
        assert given.get(option) is None or given[option] in names(kind), f"{given[option]!r} is no {kind}"


def check_emulator(name: str, *arguments: str) -> None:
    """Start an emulated device with these options on free ports, and end it at once."""
    free = {"--bind": "127.0.0.1:0", "--remote": "127.0.0.1:1", "--telnet": "127.0.0.1:0", "--udp": "127.0.0.1:0"}
    owned = {"rig": [*free], "fri": ["--bind", "--remote"], "ati": ["--telnet", "--udp"]}[name]
    argv = [free.get(arguments[n - 1], word) if n else word for n, word in enumerate(arguments)]
    argv += [word for option in owned if option not in argv for word in (option, free[option])]
    assert load("emulator", name).run([*argv, "--seconds", "0"]) == 0


def check_requirement(what: str) -> None:
    """`.[extra]` names an extra that there is, anything else a folder of the project."""
    folder, _, extras = what.rstrip("]").partition("[")
    project = tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    unknown = set(filter(None, extras.split(","))) - project.get("optional-dependencies", {}).keys()
    assert not unknown, f"{what}: no extra {unknown}"


def install(folder: str) -> None:
    """Make a distribution known as an editable installation does: its sources and its entry points on the path."""
    root = next(path for path in (Path(folder), ROOT / folder, ROOT / "examples" / folder) if path.is_dir()).resolve()
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = Path(f"{project['name'].replace('-', '_')}-{project['version']}.dist-info").resolve()
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    listed = []
    for group, items in project.get("entry-points", {}).items():
        listed += [f"[{group}]", *(f"{name} = {target}" for name, target in items.items())]
    (info / "entry_points.txt").write_text("\n".join(listed))
    sys.path[:0] = [str(info.parent), str(root / "src")]
