"""The summary of a run: every key of `summary.json` is a field here, with its unit."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from lwrprobe.contracts import FormatError, LeftOut
from lwrprobe.host.whole_file import write_whole

CUT_OFF = "cut off"
"""Status of a run that was killed before it could write its summary."""

Table = dict[str, Any]
"""One table of the file: names and plain values."""


@dataclass(slots=True, kw_only=True)
class Summary:
    """What a run did, how good it was, what each stage cost and what was left out.

    A value is None, or empty, where it is not known: what needs the true shape is known in simulation alone, and runs
    that were recorded by an earlier version lack what was added since. Errors are None where nothing was touched.
    """

    scene: str = ""
    """Name of the scene."""
    strategy: str = ""
    """Name of the strategy."""
    estimator: str = ""
    """Name of the contact estimator."""
    seed: int | None = None
    """Seed of everything random."""
    status: str = ""
    """`done`, or `ended early`."""
    reason: str = ""
    """Why the run ended, one sentence."""
    stopped_by: str = ""
    """What ended it: `strategy`, or the key of `[run.until]` that was reached; empty where it ended early."""
    contacts: int = 0
    """Number of contacts that the mesh is made from."""
    voxels: int = 0
    """Number of occupied voxels of the map."""
    sim_time_s: float = 0.0
    """s, duration on the robot's clock."""
    found_at_s: float | None = None
    """s on the robot's clock, when an object was first touched that had to be searched for; None where none was."""
    search_time_s: float | None = None
    """s on the robot's clock, until that object was bounded; None where the area was given."""
    bounds_mm: list[list[float]] | None = None
    """mm, lower and upper corner of what was then explored, in places of the sphere's centre."""
    area_raised_mm: float = 0.0
    """mm by which the area's upper end was raised, because the object was touched up to there."""
    real_time_factor: float | None = None
    """Duration on the robot's clock divided by the wall-clock time of the exploration."""
    path_length_m: float = 0.0
    """m, path of the sphere's centre."""
    contact_path_length_m: float = 0.0
    """m, the part of that path in contact."""
    peak_force_n: float | None = None
    """N, largest contact force: the true one in simulation, else the measured one."""
    peak_force_bound_n: float | None = None
    """N, above which no force was while something was touched, also between two samples of the sensor, as far as
    `contact.stiffness` and the probe's stiffness are right."""
    true_peak_force_n: float | None = None
    """N, largest true contact force of anything of the probe: sphere, stick, or both together; None on a real arm."""
    rejected_share: float | None = None
    """Share of the samples with a contact that were not accepted: too uncertain, too light, or too early in a touch."""
    warnings: list[str] = field(default_factory=list)
    """Sentences on what the result must not be used without knowing."""
    range_used: float | None = None
    """Largest share of the sensor's range that a force or torque component reached, 0 to 1."""
    link_collisions: int | None = None
    """How often a link other than the sphere and the stick's end began to touch anything; None on a real arm."""
    min_clearance_m: float | None = None
    """m, smallest distance of a watched link from the map; None without that stage."""
    sensor_gaps: int = 0
    """How often wrench samples were missing and the tip gave way until they came again."""
    reaction_late_by_s: float = 0.0
    """s by which the loop has reacted later to a force than stated, at worst; speeds towards a surface follow it."""
    reentries: int = 0
    """How often the arm had stopped by itself and was set in motion again."""
    interruptions: list[Table] = field(default_factory=list)
    """Those that the run has survived: `time_s`, `device` (`arm` or `sensor`), `reason`, `pause_s`."""
    force_guard_interventions: int = 0
    """How often the force guard took over from the strategy."""
    slowed_cycles: int = 0
    """Cycles in which a step was cut down to the joints' speed limits."""
    bridged: list[Table] = field(default_factory=list)
    """Zones narrower than the sphere: `kind`, `width_mm` [mm], `box_mm` [mm, lower and upper corner], `leaps`."""
    open_borders: list[Table] = field(default_factory=list)
    """Sides of the area where the object continues: `side`, `contacts`, `box_mm` [mm, lower and upper corner]."""
    untouched: list[Table] = field(default_factory=list)
    """Places of the mesh that no contact vouches for, largest first: `area_mm2` [mm^2], `place` [mm, lower and upper
    corner of the box around it], `reason`."""
    noise_at_rest: Table | None = None
    """Noise of the sensor at rest, when its bias was last taken: `force_n` [N] and `torque_nm` [N*m], one standard
    deviation on one axis; `over_stated`, how many times as large as the probe's resolutions let expect."""
    stillness: Table | None = None
    """Object-motion monitor: `moved_since_s` [s, None = never], `contradiction_mm` [mm], `pushed_mm` [mm];
    `torque_disagreement`: slope at which the path led into the surface by the torque and not by the force."""
    torque: Table | None = None
    """Torque and force of the sensor: `disagreement` found over the lever, `over_expected`: its ratio to two standard
    deviations of what `[uncertainty]` lets expect, 1 where it is no larger."""
    gear_waves: Table | None = None
    """Waves of the gears that the contacts were corrected for, joint by joint: `amplitude_deg`, 0 where none was sure,
    and `error_deg`, the standard deviation of the joint value that remains; null where nothing was corrected."""
    give: Table | None = None
    """What gave way under the contacts, which were corrected for it: `object_um_n` [um/N] of the object and
    `object_error_um_n`, its standard deviation; `stick_percent` and `arm_percent`, by how much both gave way more than
    stated; `touches` that it was learnt from. Null where nothing was corrected."""
    side_turn: Table | None = None
    """Turn of all normals about their path that the contacts were corrected for: `angle_deg` and `error_deg`, the
    standard deviation of what is left; null where nothing was learnt."""
    neighbour_turn: Table | None = None
    """Turn of normals to the slope that the lines beside them show: `turned`, the share of the contacts; `share`, the
    part of the angle to the slope by which they were turned; `error_deg`, the standard deviation of what is left."""
    error_budget: Table | None = None
    """Standard deviations of the contacts along their normals: `causes_mm` by name, `random_mm`, `whole_mm`; after the
    rigid motion that aligns all contacts `causes_aligned_mm` and `shape_mm` [mm]."""
    claims_within_95: float | None = None
    """Share of the contacts whose true error lies in the stated 95 % region, 0 to 1. What is shared by all contacts
    moves them together: many runs with drawn departures have 0.95 together, a single one may have 0 or 1."""
    claims_aligned_within_95: float | None = None
    """The same after the rigid motion that aligns the contacts with their true places."""
    expected_mesh_error_mm: Table | None = None
    """Expected error of the mesh's vertices that can be touched: `mean`, `p95`; of all above the lowest height of the
    sphere's centre, with what no sphere can touch: `whole_mean`, `whole_p95`; after alignment the same with `aligned_`
    before it [mm]."""
    fits: list[Table] | None = None
    """Simple shapes held against the contacts: `shape`, `warranted` or `why_not`, `share` of the contacts explained,
    `rms_mm`, and by dimension `size_mm`, `sigma_mm` and, after alignment, `sigma_aligned_mm`."""
    coverage: float | None = None
    """Share of the reachable surface that has a contact within half the line spacing plus 1 mm which faces the same way
    within 60 degrees, 0 to 1; after the rigid motion that aligns the contacts with their true places. Null where
    nothing of the object can be reached in the area."""
    coverage_upright: float | None = None
    """The same of what a probe held upright can reach."""
    coverage_5mm: float | None = None
    """Share of the reachable surface that has a contact within 5 mm which faces the same way."""
    coverage_over_time: list[list[float]] | None = None
    """Rows of (time [s], coverage)."""
    end_errors_mm: list[float | None] | None = None
    """mm, how far the contacts fall short of (+) or pass (-) the object's two ends in x."""
    contact_error_mm: Table | None = None
    """mm, accepted contact point to true contact point: `median`, `mean`, `rms`, `p95`, `max`."""
    contact_error_aligned_mm: Table | None = None
    """The same after the rigid motion that makes it smallest in least squares: the error of shape, not of place."""
    surface_error_mm: Table | None = None
    """mm, contact point to true surface: `median`, `mean`, `rms`, `p95`, `max`."""
    voxel_error_mm: Table | None = None
    """mm, centre of an occupied voxel to true surface: `median`, `mean`, `rms`, `p95`, `max`."""
    normal_error_deg: Table | None = None
    """Degrees, estimated to true normal: `median`, `mean`, `p95`, `max`."""
    mesh_error_mm: Table | None = None
    """Mesh against the true shape: `method`, lengths in mm, `normals_deg`, `watertight`, `volume_error`, `iou`."""
    mesh_error_aligned_mm: Table | None = None
    """The same after the rigid motion that aligns the mesh with the true surface."""
    mesh_error_reachable_aligned_mm: Table | None = None
    """Its `mean` and `p95` of what the sphere can reach; empty where that is nothing."""
    mesh_error_upright_aligned_mm: Table | None = None
    """The same of what a probe held upright can reach."""
    certified_mm: float | None = None
    """mm, no larger ball can hide within reach of the probe."""
    certificate: Table | None = None
    """Where a ball that large fits, `at_mm`; volumes that were not swept, `unknown_cm3` within reach and
    `out_of_reach_cm3` with the inside of the object; `grid_mm`, how finely space was divided."""
    error_against_time: list[Table] | None = None
    """Rows of `time_s`, `certified_mm` and, where the true shape is known, `gap_mean_mm` and `gap_p95_mm`: from the
    reachable true surface to the nearest contact; None before the first contact."""
    lower_bound_time_s: float | None = None
    """s, no exploration of this object at this line spacing and speed is faster; free space counts at free speed."""
    lower_bound_descending_s: float | None = None
    """s, the same where the path down to an edge has to be slow enough for the force limit."""
    lower_bound_unknown_s: float | None = None
    """s, as `lower_bound_descending_s`, with free space at the approach speed: no strategy knows before that it is
    free."""
    truth: Table | None = None
    """How the simulated world differed from the scene: `profile`, and the numbers drawn; None on a real arm."""
    cycle_us: float | None = None
    """us of computing time, median over the arm's cycles."""
    force_control: Table = field(default_factory=dict)
    """Force loop: `delay_s` [s], `stiffness_along_stick` [N/m], `stability_number`, `damping` [N s/m] and more."""
    stages: list[Table] = field(default_factory=list)
    """Computing time a stage: `name`, `calls`, `us_median` [us], `us_p99` [us], `us_max` [us], `share` of the total."""
    left_out: list[LeftOut] = field(default_factory=list)
    """What the run did without: `stage`, `why`."""
    wrench_counters: Table = field(default_factory=dict)
    """Number of wrench samples by kind: `samples`, `invalid`, `saturated`, `lost`, `late` and more."""
    versions: dict[str, str] = field(default_factory=dict)
    """Versions of the packages that the figures depend on."""
    machine: dict[str, str] = field(default_factory=dict)
    """Processor, cores, system, Python."""
    table_found: Table | None = None
    """Where the table was touched by mistake: its plane and the `contacts` left out for it; None where it was not."""
    limits_used: dict[str, float] = field(default_factory=dict)
    """Largest share used of each limit of the motion guard, 0 to 1."""
    devices: dict[str, Table] = field(default_factory=dict)
    """What each driver counted on its connection, by the driver's name."""
    resumed: Table | None = None
    """For a run that was resumed: `from_s` [s], `contacts_before`."""
    unreachable_area: str = ""
    """The part of the area that the arm cannot reach, one sentence; empty where it reaches all."""
    wall_time_s: float | None = None
    """s of wall-clock time in all."""
    wall_time_parts_s: dict[str, float] = field(default_factory=dict)
    """s of wall-clock time: `prepare`, `compile`, `explore`, `finish`."""
    merged: list[Table] | None = None
    """For several runs merged into one: `folder`, `contacts`, `strategy` and `registration` of each."""
    reconstruction: Table | None = None
    """For merged runs: the reconstructor's report."""
    line_spacing_m: float | None = None
    """m between two neighbouring lines of the strategy, of merged runs the largest; None for one without lines."""
    other: Table = field(default_factory=dict)
    """Keys that this version does not know, as they stand in the file."""

    @property
    def truth_known(self) -> bool:
        """Whether the run's drivers knew the true shape, as those of simulated and of emulated devices do."""
        return self.link_collisions is not None

    def as_dict(self) -> dict[str, Any]:
        """The content of `summary.json`."""
        known = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "other"}
        return known | self.other

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Summary:
        """From the content of a `summary.json`; missing keys keep their defaults, unknown ones go to `other`."""
        names = {f.name for f in fields(cls)} - {"other"}
        known = {key: value for key, value in content.items() if key in names}
        return cls(**known, other={key: value for key, value in content.items() if key not in names})

    @classmethod
    def read(cls, path: str | Path) -> Summary:
        """From a file. Raises FormatError, naming the file, for one that is no summary."""
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
        except (ValueError, OSError, RecursionError) as error:
            raise FormatError(f"{path}: not a summary: {error}") from None
        if not isinstance(content, dict):
            raise FormatError(f"{path}: not a summary: it holds a {type(content).__name__}, allowed: an object")
        return cls.from_dict(content)

    def write(self, path: str | Path) -> Path:
        """Write `summary.json`, whole or not at all; the path. Raises StorageError."""
        path = Path(path)
        write_whole(path, (json.dumps(self.as_dict(), indent=1) + "\n").encode())
        return path


def area_by_reason(untouched: list[Table]) -> list[tuple[str, float]]:
    """Reason and area [mm^2] of what was left untouched for it, largest first; of the places in `Summary.untouched`."""
    areas: dict[str, float] = {}
    for place in untouched:
        areas[place["reason"]] = areas.get(place["reason"], 0.0) + float(place["area_mm2"])
    return sorted(areas.items(), key=lambda one: -one[1])
