"""The strategy contract: what a strategy has, and the message for one of an older version."""

from importlib.metadata import EntryPoint

import pytest

from lwrprobe.contracts import PluginError, Strategy, plugins
from lwrprobe.contracts.strategy import STRATEGY_CHANGES
from lwrprobe_strategies.grid_version import GridVersion
from lwrprobe_strategies.orientation_change import OrientationChange
from lwrprobe_strategies.surface_contour import SurfaceContour
from strategy_task import task


@pytest.mark.parametrize("kind", [GridVersion, SurfaceContour, OrientationChange])
def test_a_built_in_strategy_has_what_the_contract_asks_for(kind):
    strategy = kind()
    strategy.start(task())
    assert isinstance(strategy, Strategy)
    assert strategy.line_spacing == kind.Config().step
    assert list(strategy.trace) == []
    progress = strategy.progress()
    assert progress.covered == 0.0
    assert progress.doing.startswith("grid line, 1 of ")
    assert progress.state == "transit"


@pytest.mark.parametrize(
    "text",
    ["from lwrprobe.contracts import Feed\n", "class Old:\n    contract = 1\n"],
    ids=["an old name", "an old version"],
)
def test_a_strategy_for_version_1_is_told_what_to_change(text, tmp_path, monkeypatch):
    (tmp_path / "old_plugin.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    entry = EntryPoint("old", "old_plugin:Old", "lwrprobe.strategies")
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
    with pytest.raises(PluginError) as raised:
        plugins.load("strategy", "old")
    assert STRATEGY_CHANGES[1] in str(raised.value)
    monkeypatch.delitem(__import__("sys").modules, "old_plugin", raising=False)


def test_a_name_that_never_was_is_an_ordinary_error():
    import lwrprobe.contracts as contracts

    with pytest.raises(AttributeError, match="no attribute 'Gait'"):
        _ = contracts.Gait
