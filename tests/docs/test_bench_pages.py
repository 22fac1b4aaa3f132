"""The pages of the benches: three sentences and a short table first, every table whole in a CSV file."""

import csv
import re
from pathlib import Path

import pytest

from lwrprobe.bench import BENCHES
from lwrprobe.bench.page import COLUMNS, NAMED, SUMMARIES
from lwrprobe.bench.report import BenchReport, Table, Verdict
from lwrprobe.contracts import StorageError

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "bench"
PAGES = sorted(path for path in FOLDER.glob("*.md") if path.stem != "index")


def test_every_bench_has_a_summary():
    assert SUMMARIES.keys() == BENCHES.keys()


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_published_page(page):
    head, _, rest = page.read_text().partition("\n## Tables\n")
    title, text, table, *_ = head.split("\n\n")
    assert title.startswith("# ")
    assert len(text.splitlines()) == 3
    assert 2 <= table.splitlines()[0].count("|") - 1 <= COLUMNS
    assert all(line.count("|") - 1 <= COLUMNS for line in page.read_text().splitlines() if line.startswith("|--"))
    linked = re.findall(r"\[Full table as CSV\]\((.*?)\) \((\d+) rows, (\d+) columns\)", rest)
    assert {name for name, _, _ in linked} == {path.name for path in FOLDER.glob(f"{page.stem}-[0-9]*.csv")}
    for name, rows, columns in linked:
        with (FOLDER / name).open(newline="") as file:
            table = list(csv.reader(file))
        assert len(table) == int(rows) + 1
        assert {len(row) for row in table} == {int(columns)}


@pytest.fixture
def report():
    columns = ["voxels", *(f"figure {n}" for n in range(11)), "lwrprobe median"]
    table = Table("us a query", columns, [[100000, *range(11), 1 / 3]])
    verdicts = [Verdict(f"bound {n}", "7", n == 0) for n in range(NAMED + 3)]
    return BenchReport("clearance", "Clearance", [table], verdicts, notes=["a note"], date="2026-01-02")


def test_page_of_a_report(report, tmp_path):
    page, table = report.write(out=tmp_path)
    text = page.read_text()
    assert f"1 of {NAMED + 3} requirements are met; not met: bound 1; " in text
    assert "; and 2 more." in text
    assert "were left out of this run" in text  # coal's figures are missing
    assert "on 2026-01-02" in text
    assert "| 1.0000" not in text
    assert "0.3333 |" in text
    assert max(line.count("|") for line in text.splitlines()) <= COLUMNS + 1
    with table.open(newline="") as file:
        assert list(csv.reader(file))[1][-1] == str(1 / 3)


@pytest.mark.parametrize("name", ["clearance.json", "clearance.md", "clearance-1.csv", "clearance-drawn.png"])
def test_a_full_disk_is_one_error_and_keeps_what_was_there(report, tmp_path, name):
    report.figures["drawn"] = lambda figure: figure.subplots().plot([0, 1])
    (tmp_path / name).write_text("as it was")
    (tmp_path / f"{name}.part").symlink_to("/dev/full")
    with pytest.raises(StorageError, match=name):
        report.write(tmp_path / "clearance.json", tmp_path)
    assert (tmp_path / name).read_text() == "as it was"


def test_sentence_with_the_figures_of_the_tables(report):
    report.tables[0].columns[1:3] = ["lwrprobe p99", "coal median"]
    report.tables.append(Table("Times as long", ["voxels", "coal median", "python-fcl median"], [[100000, 4.0, 5.5]]))
    assert "takes 0.3333 us in the median; coal takes 4 times and python-fcl 5.5 times as long." in report.as_markdown()


def test_a_bench_without_a_summary_still_has_a_page():
    page = BenchReport("new", "New", [Table("One", ["a"], [[True], [None]])]).as_markdown()
    assert "| yes |" in page
    assert "[Full table as CSV](new-1.csv) (2 rows, 1 columns)" in page
