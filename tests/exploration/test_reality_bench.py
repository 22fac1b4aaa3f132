"""The bench of departures: each row changes one thing, and what is asked for wrongly is refused."""

import pytest

from lwrprobe.bench import reality
from lwrprobe.bench.exploration import STRATEGIES
from lwrprobe.bench.report import BenchReport
from lwrprobe.contracts import InputError, UnknownNameError
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


def run_of(**changed):
    fine = {
        "variant": "datasheet", "scene": "block", "strategy": "grid_version", "seed": 1, "status": "done", "peak": 2.0,
        "claims": 0.95, "claims_aligned": 0.95, "untold": False, "false_reason": False,
    }  # fmt: skip
    return fine | changed


def verdicts_of(*found):
    report = BenchReport("reality", "")
    reality._report_profiles(report, list(found))
    return {v.requirement: v for v in report.verdicts}


def test_each_profile_is_asked_for_what_it_can_hold():
    found = verdicts_of(run_of(status="ended early"), run_of(untold=True), run_of(variant="lab", status="ended early"))
    assert "datasheet: status done" not in found
    assert found["lab: status done"].measured.startswith("0 of 1; not block/grid_version/1")
    assert found["datasheet: nothing silently wrong"].measured.startswith("1 of 2")
    assert found["datasheet: no false reason"].held
    assert not verdicts_of(run_of(false_reason=True))["datasheet: no false reason"].held


def test_stated_regions_are_judged_over_all_draws():
    """With 95 % of the errors inside, one draw in twenty has nearly none of its contacts there."""
    text = "datasheet: 90% to 98% of the errors in the 95 % region, absolute"
    assert verdicts_of(*[run_of(claims=1.0)] * 19, run_of(claims=0.0))[text].held
    assert not verdicts_of(*[run_of(claims=1.0)] * 19)[text].held


def test_runs_of_one_draw_share_their_world_and_others_do_not():
    given = [(scene, strategy, draw) for scene in ("block", "bridge") for strategy in STRATEGIES for draw in (1, 2)]
    seeds = {(profile, *each): reality._whole(profile, *each).seed for profile in reality.STATED for each in given}
    assert len(set(seeds.values())) == len(given)
    assert len({seeds["datasheet", *given[0]], seeds["calibrated", *given[0]], seeds["lab", *given[0]]}) == 1


@pytest.mark.parametrize("options", [{"rows": "gian 1 %"}, {"profiles": "good"}, {"seeds": "3"}])
def test_unknown_names_are_refused(options):
    with pytest.raises(UnknownNameError):
        reality.run(False, options)


@pytest.mark.parametrize(("count", "runs"), [("2", [2, 2, 2]), ("3,1", [3, 1, 1])])
def test_each_profile_may_have_draws_of_its_own(monkeypatch, count, runs):
    asked = []
    monkeypatch.setattr(reality, "run_kept", lambda tasks, *_: asked.extend(tasks.values()) or {k: {} for k in tasks})
    monkeypatch.setattr(reality, "_report_profiles", lambda *_: None)
    options = {"rows": "none", "scenes": "block", "strategies": "grid_version", "count": count}
    reality.run(False, options | {"profiles": "lab,datasheet,calibrated"})
    assert [sum(task.variant == name for task in asked) for name in ("lab", "datasheet", "calibrated")] == runs
    with pytest.raises(InputError, match="count"):
        reality.run(False, {"count": "3,0"})


@pytest.mark.slow
def test_a_run_becomes_a_row_with_its_figures(monkeypatch, tmp_path):
    exploration, made = procedure.Exploration, []

    def short(scene):
        made.append(scene)
        return exploration(load_scene(scene, ["run.time_limit=25.0"]))

    monkeypatch.setattr(procedure, "Exploration", short)
    options = {"rows": "probe 0.5 mm longer", "profiles": "lab", "count": "1", "journal": str(tmp_path / "j.jsonl")}
    options |= {"scenes": "block", "strategies": "grid_version"}
    report = reality.run(False, options)
    [single], [whole] = report.data["departures"], report.data["runs"]
    assert single["truth"] == {"profile": "ideal", "probe_length_mm": [0.5]}
    assert single["contact"] == pytest.approx(0.5, abs=0.1)
    assert single["aligned"] < 0.2
    assert whole["truth"]["profile"] == "lab"
    assert len(report.tables) == 3
    assert whole["curves"][0][-2] == pytest.approx(whole["claims"], abs=1e-3), "the 95 % region is one of the curve's"
    done = [v.measured for v in report.verdicts if v.requirement.endswith("status done")]
    assert [text.partition(";")[0] for text in done] == ["0 of 1", "0 of 1"], "cut short, neither was done"
    again = reality.run(False, options | {"profiles": "none"})
    assert again.data == {"departures": [single]}
    assert len(made) == 2, "a run whose record is kept is not made again"
