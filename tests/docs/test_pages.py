"""Every block of code and every command of the documentation is carried out (tests/docs/page_runner.py says how)."""

import re
import sys

import pytest
from page_runner import PAGES, ROOT, PageRunner, blocks, check_line, lines

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(sys.modules, "page", None)
    runner = PageRunner()
    for block in blocks(page):
        try:
            runner.run(block)
        except BaseException as error:
            error.add_note(f"{page.relative_to(ROOT)}:{block.line}")
            raise


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_to_files_lead_somewhere(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", text):
        made = target.startswith("generated/") or "/generated/" in target
        assert made or (page.parent / target).exists(), f"{page.name}: {target}"


@pytest.mark.parametrize(
    "line",
    [
        "lwrprobe explroe block",
        "lwrprobe explore block --sead 7",
        "lwrprobe explore block --set strategy.stpe",
        "lwrprobe explore no_such_scene",
        "lwrprobe explore block --strategy wander",
        "python3 scripts/no_such.py",
        "pip install .[no_such_extra]",
        "make coffee",
    ],
)
def test_a_wrong_line_is_found(line):
    with pytest.raises(BaseException, match=r".") as caught:
        check_line(lines(line)[0])
    assert not isinstance(caught.value, KeyboardInterrupt)
