"""The page on real devices: its scene is valid, its messages are those of the drivers, its emulator lines parse."""

import re
import shlex
from pathlib import Path

import pytest

from lwrprobe.contracts.options import configure
from lwrprobe.contracts.plugins import load
from lwrprobe.scene import load_scene

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "how-to" / "real-devices.md").read_text()


def test_scene_of_the_page(tmp_path):
    file = tmp_path / "my_scene.toml"
    file.write_text(re.search(r"```toml file=my_scene.toml\n(.*?)```", PAGE, re.DOTALL)[1])
    scene = load_scene(file)
    for name in ("fri", "ati"):
        config = configure(load("driver", name).Config, scene.drivers[name], f"drivers.{name}")
        assert config != load("driver", name).Config()


def test_settings_of_the_page_are_those_of_the_scene():
    known = load_scene("empty").safety.model_dump()
    named = re.findall(r"`safety\.(\w+)`", PAGE)
    assert set(named) >= {"margin", "torque_share", "following", "silence"}
    assert set(named) <= known.keys()


@pytest.mark.parametrize("line", re.findall(r"lwrprobe emulate ((?:fri|ati) --.*)", PAGE))
def test_emulator_lines_of_the_page(line, capsys):
    name, *argv = shlex.split(line)
    # Port 0 and no time: the options are what is tried here, not the ports of this machine.
    argv = [re.sub(r"(?<=127\.0\.0\.1:)\d+", "0", word) for word in argv]
    argv = [word.replace(":0", ":1") if argv[i - 1] == "--remote" else word for i, word in enumerate(argv)]
    assert load("emulator", name).run([*argv, "--seconds", "0"]) == 0


def test_sentences_of_the_page_are_those_of_the_code():
    files = [*(ROOT / "drivers").rglob("*.py"), *(ROOT / "src" / "lwrprobe" / "exploration").rglob("*.py")]
    source = "".join(file.read_text() for file in files)
    for words in (
        "no usable wrench sample for",
        "the sensor cannot be relied on:",
        "end of its range,",
        "the set point was not sent:",
        "rad away from its set point",
        "no measurement came",
        "datagrams came from other addresses",
        "did not become",
        "command mode was not entered",
        "left command mode: now",
        "drive errors 0x",
        "has been silent for",
        "set point refused:",
        "clock has jumped: it was restarted",
        "were malformed",
        "cannot bind ",
        "another client may hold the console",
        "sends nothing any more and has closed its console: another",
        "sends nothing to ",
        "no usable record from ",
        "no data line from ",
        "was answered with:",
    ):
        assert words in PAGE
        assert words in source
