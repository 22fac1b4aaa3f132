"""A run's page: whole in one file, small, honest about what is missing, and readable in a browser."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest

from lwrprobe.bench.sampled_lines import sample_lines
from lwrprobe.evaluation.charts import Line, bars, histogram, line_chart, ticks
from lwrprobe.evaluation.run_folder import read_run
from lwrprobe.evaluation.run_report import write_report
from lwrprobe.scene import load_scene, write_scene

pytestmark = pytest.mark.slow

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
OPEN_TAGS = {"meta", "img", "br", "link", "input"}


def make_run(folder, name, summary=True):
    folder.mkdir()
    scene = load_scene(name, ["truth.profile=ideal", "reconstruction.method=contact_surface"])
    write_scene(scene, folder / "scene.toml")
    record = sample_lines(scene.solid(), 0.01, 0.25)
    rows = [
        f"{0.05 * i:.4f}," + ",".join(f"{v:.7f}" for v in (*p, *n)) + ",0.8,0.9"
        for i, (p, n) in enumerate(zip(record.points, record.normals))
    ]
    (folder / "contacts.csv").write_text("time,x,y,z,nx,ny,nz,force,confidence\n" + "\n".join(rows) + "\n")
    trace = "\n".join(
        f"{0.05 * i},{p[0]},{p[1]},{p[2]},{0.5 + 0.5 * np.sin(i)},0,inf,line" for i, p in enumerate(record.free_path)
    )
    (folder / "trace.csv").write_text("time,x,y,z,force,touching,clearance,state\n" + trace + "\n")
    if summary:
        content = {
            "status": "done", "reason": "area covered <all>", "sim_time_s": 42.0, "coverage": 0.97,
            "peak_force_n": 1.5, "link_collisions": 0,
            "stages": [{"name": "arm", "calls": 9, "us_median": 2.0, "us_p99": 3.0, "share": 0.4}],
            "left_out": [{"stage": "friction", "why": "it is zero"}], "versions": {"numpy": "2"}, "machine": {},
        }  # fmt: skip
        (folder / "summary.json").write_text(json.dumps(content))
    return folder


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return write_report(make_run(tmp_path_factory.mktemp("runs") / "bridge", "bridge"))


class Balance(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.images, self.text = [], [], []

    def handle_starttag(self, tag, attributes):
        if tag not in OPEN_TAGS:
            self.open.append(tag)
        if tag == "img":
            self.images.append(dict(attributes)["src"])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_page_is_one_small_whole_file(page):
    content = page.read_text(encoding="utf-8")
    assert len(content.encode()) < 5e6
    parsed = Balance()
    parsed.feed(content)
    assert parsed.open == []
    assert len(parsed.images) == 10  # contacts, shape, beyond reach, expected error, deviation; from two sides each
    assert all(source.startswith("data:image/png;base64,") for source in parsed.images)
    assert not re.search(r'(?:src|href)="(?!data:)', content)
    assert not re.search(r"https?://|@import|url\(", content)
    assert sorted(path.name for path in page.parent.iterdir()) == [
        "contacts.csv", "report.html", "scene.toml", "summary.json", "trace.csv",
    ]  # fmt: skip


def test_it_tells_what_was_explored_and_how_well(page):
    parsed = Balance()
    parsed.feed(page.read_text(encoding="utf-8"))
    text = " ".join(parsed.text)
    for words in (
        "area covered <all>", "Coverage", "Error", "Force", "limit 3 N", "no box", "friction", "it is zero",
        "lwrprobe explore scene.toml", "beyond reach", "Expected error", "seed", "contact_surface",
    ):  # fmt: skip
        assert words in text


def test_a_run_that_was_killed_has_its_page(tmp_path):
    path = write_report(make_run(tmp_path / "block", "block", summary=False))
    assert "did not get to its end" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("driver", "summary", "known"),
    [("mujoco", True, True), ("mujoco", False, True), ("fri", True, True), ("fri", False, False), ("sim", False, True)],
)
def test_the_truth_is_known_where_a_driver_knew_it_or_a_simulator_was_cut_off(tmp_path, driver, summary, known):
    """The report had it for the driver `sim` alone, while the summary and the preview have it for all that knew it."""
    folder = make_run(tmp_path / "block", "block", summary)
    scene = load_scene(folder / "scene.toml", [f"arm.driver={driver}"])
    write_scene(scene, folder / "scene.toml")
    assert ("Against the truth" in write_report(folder).read_text(encoding="utf-8")) is known
    assert (read_run(folder).true_solid() is not None) is known


def test_a_run_without_contacts_has_its_page(tmp_path):
    folder = make_run(tmp_path / "block", "block")
    header = (folder / "contacts.csv").read_text().splitlines()[0]
    (folder / "contacts.csv").write_text(header + "\n")
    assert "Nothing was touched" in write_report(folder).read_text(encoding="utf-8")


PROBE = """<script>addEventListener("load", () => setTimeout(() => {
  const layout = { wide: document.documentElement.scrollWidth, window: innerWidth,
    paper: getComputedStyle(document.body).backgroundColor, ink: getComputedStyle(document.body).color,
    images: [...document.images].every((i) => i.complete && i.naturalWidth === 560),
    viewer: document.getElementById("viewer") ? document.getElementById("viewer").dataset.drawn || "no" : "none",
    columns: getComputedStyle(document.querySelector(".grid")).gridTemplateColumns.split(" ").length };
  document.body.innerHTML = ""; document.title = "layout " + JSON.stringify(layout); }, 500));</script>"""


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [500, 1280])
def test_it_opens_in_a_browser(page, tmp_path, width, dark):
    """In real Chromium where it is installed; elsewhere the rules that it would follow are looked for."""
    content = page.read_text(encoding="utf-8")
    if CHROMIUM is None:
        assert 'name="viewport"' in content
        assert "prefers-color-scheme: dark" in content
        assert "minmax(min(100%" in content
        return
    probed = tmp_path / "probed.html"
    probed.write_text(content.replace("</body>", PROBE + "</body>"), encoding="utf-8")
    done = subprocess.run(
        [
            CHROMIUM, "--headless", "--no-sandbox", "--disable-dev-shm-usage",
            f"--user-data-dir={tmp_path / 'profile'}",
            "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", f"--window-size={width},900",
            f"--blink-settings=preferredColorScheme={0 if dark else 1}", "--virtual-time-budget=8000", "--dump-dom",
            probed.as_uri(),
        ],
        capture_output=True, text=True, timeout=180,
    )  # fmt: skip
    found = re.search(r"<title>layout (\{.*?\})</title>", done.stdout)
    assert found, done.stderr[-2000:]
    layout = json.loads(found.group(1))
    assert layout["wide"] <= layout["window"]
    assert layout["images"]
    assert layout["viewer"] in ("yes", "none")  # none where the machine has no WebGL 2
    assert layout["columns"] == (1 if width < 900 else 2)
    paper, ink = (sum(int(v) for v in re.findall(r"\d+", layout[name])[:3]) for name in ("paper", "ink"))
    assert (paper < ink) == dark


def test_ticks_are_round_and_inside():
    assert ticks(0.0, 1.0).tolist() == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert ticks(-2.0, 2.0, 5).tolist() == pytest.approx([-2.0, -1.0, 0.0, 1.0, 2.0])


def test_charts_put_values_where_they_belong():
    chart = line_chart([Line(np.array([0.0, 10.0]), np.array([0.0, 5.0]), "a<b", "a")], "x", "y", top=5.0)
    assert "M58.0 206.0 L504.0 18.0" in chart
    two = [Line(np.array([0.0]), np.array([1.0]), name) for name in ("a<b", "c")]
    assert "a&lt;b" in line_chart(two, "x", "y")
    dots = line_chart([Line(np.array([0.0]), np.array([0.1]), "d", dots=True)] * 2, "x", "y", decades=True)
    assert 'cy="206.0"' in dots
    late = line_chart([Line(np.arange(3.0), np.array([np.inf, 2.0, np.nan]), "late")], "x", "y", top=4.0)
    assert "M281.0 112.0" in late


def test_a_histogram_counts_what_lies_beyond_in_its_last_bins():
    chart = histogram(np.array([-9.0, 0.0, 0.0, 9.0]), "mm", 2.0, bins=5)
    heights = sorted(float(h) for h in re.findall(r'class="bar a"[^>]*height="([\d.]+)"', chart))
    assert len(heights) == 3
    assert heights[2] == pytest.approx(2.0 * heights[0], rel=0.01)


def test_bars_are_as_long_as_their_values():
    widths = [
        float(w) for w in re.findall(r'class="bar a"[^>]*width="([\d.]+)"', bars([("a", 4.0, ""), ("b", 1.0, "")]))
    ]
    assert widths[0] == pytest.approx(4.0 * widths[1], rel=0.01)
