"""Progress displays: a bar in a terminal, one line of HTML in a notebook, nothing where it is quiet."""

import sys
from types import SimpleNamespace

import pytest

from lwrprobe.contracts import Progress
from lwrprobe.exploration.loop.explorer import ProgressSnapshot
from lwrprobe.runs.progress import NotebookProgress, ProgressLine, progress_display

SNAPSHOT = ProgressSnapshot(12.0, 0.5, Progress("line <3>", 0.25), 42, 0.8)


@pytest.fixture
def shown(monkeypatch):
    """What a notebook would show, by stand-ins for the parts of IPython that are used; each entry is one picture."""
    pictures = []

    class Handle:
        def update(self, content):
            pictures[-1] = content

    def display(content, display_id):
        pictures.append(content)
        return Handle()

    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=object()))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(HTML=str, display=display))
    return pictures


def test_a_notebook_has_one_line_that_is_rewritten(shown):
    display = progress_display()
    assert isinstance(display, NotebookProgress)
    with display:
        display.message("loading <scene>")
        assert shown == ["<i>loading &lt;scene&gt;</i>"]
        display.watch(SNAPSHOT)
    assert len(shown) == 1
    assert 'value="0.250"' in shown[0]
    assert "25% line &lt;3&gt;" in shown[0]
    assert "42 contacts" in shown[0]


def test_a_quiet_notebook_shows_nothing(shown):
    display = progress_display(quiet=True)
    with display:
        display.message("loading")
        display.watch(SNAPSHOT)
    assert shown == []


def test_a_script_has_its_line_on_standard_error(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    display = progress_display()
    assert isinstance(display, ProgressLine)
    with display:
        display.message("exploring")
        display.watch(SNAPSHOT)
    caught = capsys.readouterr()
    assert caught.out == ""
    assert "exploring" in caught.err


@pytest.mark.parametrize("sentence", ["x[/y]/s.toml", "more than [probe] states", "[bold]as it is[/bold]"])
def test_a_sentence_is_shown_as_it_is(monkeypatch, capsys, sentence):
    monkeypatch.setenv("COLUMNS", "200")
    with ProgressLine(False) as display:
        display.message(sentence)
        display.watch(ProgressSnapshot(12.0, 0.5, Progress(sentence, 0.25), 42, 0.8))
    assert capsys.readouterr().err.count(sentence) >= 1


def test_quiet_is_quiet(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    with progress_display(quiet=True) as display:
        display.message("exploring")
        display.watch(SNAPSHOT)
    assert capsys.readouterr() == ("", "")
