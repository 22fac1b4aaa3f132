"""The bench of departures: each row changes one thing, and what is asked for wrongly is refused."""

import pytest

from lwrprobe.bench import reality
from lwrprobe.contracts import UnknownNameError
from lwrprobe.exploration.procedures import explore as procedure
from lwrprobe.scene import load_scene


@pytest.mark.parametrize("row", reality.ROWS, ids=lambda row: row.name)
def test_each_row_sets_what_it_names_and_is_drawn_where_it_says_so(row):
    first, second = (
        load_scene(
            "block", [f"truth.{setting}" for setting in ("profile=ideal", *row.settings, f"seed={seed}")]
        ).truth.draw(7, 7)
        for seed in (1, 2)
    )
    assert set(first) == {setting.partition("=")[0] for setting in row.settings}
    same = all((first[name] == second[name]).all() for name in first)
    assert same is not row.drawn


@pytest.mark.parametrize("options", [{"rows": "gian 1 %"}, {"profiles": "good"}, {"seeds": "3"}])
def test_unknown_names_are_refused(options):
    with pytest.raises(UnknownNameError):
        reality.run(False, options)


@pytest.mark.slow
def test_a_run_becomes_a_row_with_its_figures(monkeypatch):
    explore = procedure.explore

    def short(scene):
        return explore(load_scene(scene, ["run.time_limit=25.0"]))

    monkeypatch.setattr(procedure, "explore", short)
    options = {"rows": "probe 0.5 mm longer", "profiles": "lab", "count": "1"}
    report = reality.run(False, options | {"scenes": "block", "strategies": "grid_version"})
    single, whole = report.data["runs"]
    assert single["truth"] == {"profile": "ideal", "probe_length_mm": [0.5]}
    assert single["contact"] == pytest.approx(0.5, abs=0.1)
    assert single["aligned"] < 0.2
    assert whole["truth"]["profile"] == "lab"
    assert len(report.tables) == 2
    assert report.verdicts[0].measured == "0 of 2"  # cut short, neither was done
