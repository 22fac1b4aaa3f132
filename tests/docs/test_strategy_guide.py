"""The guide writes the very files of its example."""

from page_runner import ROOT, blocks

PAGE = ROOT / "docs" / "how-to" / "write-your-own-strategy.md"


def test_the_guide_writes_the_files_of_its_example():
    written = {block.word.removeprefix("file="): block.text for block in blocks(PAGE) if block.word.startswith("file=")}
    assert written
    for name, text in written.items():
        assert text == (ROOT / "examples" / name).read_text(encoding="utf-8"), name


def test_the_strategy_fits_in_sixty_lines():
    (source,) = [block for block in blocks(PAGE) if block.word.endswith("__init__.py")]
    assert source.text.count("\n") <= 60
