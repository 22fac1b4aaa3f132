"""Tables in a terminal: every cell is shown whole, no line is wider than the terminal."""

import io
import re

import pytest
from answer import ask
from rich.console import Console

from lwrprobe.bench.report import BenchReport
from lwrprobe.cli.bench import show
from lwrprobe.cli.explore import finish
from lwrprobe.cli.table import print_table
from lwrprobe.evaluation.summary import Summary

COLUMNS = ["library", "case", "median [us]", "p99 of work [us]", "success [%]", "answer", "error of the nearest pose"]
ROWS = [
    ["lwrprobe", "near", "2.434", "3.555", "100", "UNREACHABLE and the nearest pose", "1.153e-15"],
    ["lwrprobe", "random", "2.404", "3.406", "100", "InputError: pose", "-"],
    ["rtb LM chan", "near", "17.44", "30.001", "99.5", "[bold]nothing[/bold]", "-"],
    ["rtb LM chan", "random", "61.92", "359.8", "98", "success reported", "2.5e-3"],
]


def printed(width, columns, rows, title="Hard cases, success in % [mm]"):
    stream = io.StringIO()
    print_table(Console(file=stream, width=width), title, columns, rows)
    return stream.getvalue()


@pytest.mark.parametrize("width", [200, 120, 80, 60, 40])
def test_no_line_is_wider_than_the_terminal_and_nothing_is_cut(width):
    text = printed(width, COLUMNS, ROWS)
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    assert "…" not in text
    for word in " ".join([*COLUMNS, *(cell for row in ROWS for cell in row)]).split():
        assert word in text


def test_a_table_that_fits_is_one_part():
    text = printed(200, COLUMNS, ROWS)
    assert text.count("lwrprobe") == 2
    assert len([line for line in text.splitlines() if set(line.strip()) == {"─"}]) == 1


def test_each_part_names_its_rows():
    parts = re.split(r"\n\s*\n(?=\S|\s+\S)", printed(60, COLUMNS, ROWS).strip())
    tables = [part for part in parts if "─" in part]
    assert len(tables) > 1
    for table in tables:
        body = table.split("─\n")[1]
        assert body.count("lwrprobe") == 2
        assert body.count("rtb LM chan") == 2
        assert body.count("random") == 2


def test_a_word_wider_than_the_terminal_is_folded():
    word = "x" * 95
    text = printed(40, ["name", "path"], [["a", word]])
    assert max(map(len, text.splitlines())) <= 40
    assert text.count("x") == 95


def test_an_empty_table_shows_its_head():
    assert "median [us]" in printed(120, COLUMNS, [])


MARKED = ["x[/y]/s.toml", "more than [probe] states", "[bold]as it is[/bold]"]


@pytest.mark.parametrize("text", MARKED)
def test_how_a_run_ended_is_shown_as_it_is(capsys, monkeypatch, text):
    monkeypatch.setenv("COLUMNS", "200")
    summary = Summary(
        scene="block", status="done", reason=text, warnings=[text], real_time_factor=1.0, peak_force_n=1.0
    )
    finish(summary.as_dict(), text, as_json=False, quiet=False)
    assert capsys.readouterr().err.count(text) == 3


@pytest.mark.parametrize("text", MARKED)
def test_a_bench_is_shown_as_it_is(text):
    report = BenchReport("made up", text, notes=[text])
    report.require(text, text, True)
    stream = io.StringIO()
    show(report, Console(file=stream, width=200))
    assert stream.getvalue().count(text) == 4


def test_a_scene_file_may_have_brackets_in_its_path(tmp_path):
    done = ask("explore", "x[/y]/s.toml", folder=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "existing scene file" in done.stderr
