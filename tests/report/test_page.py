import html
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from browser import Browser, in_browser, sheets_of

import mechsim as ms
from mechsim.files import plain
from mechsim.report import page as report

ANGLES = np.linspace(0.0, 2.0 * np.pi, 37)
# a minimal PNG
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c4890000000d49444154789c6360606060000000050001"
    "a5f645400000000049454e44ae426082"
)


def tags_in(page):
    """Return the names of a page's tags; what a script contains is none."""
    return re.findall(r"<(\w+)", re.sub(r"(<script[^>]*>).*?</script>", r"\1", page, flags=re.DOTALL))


def text_in(page):
    """Return the text of a page, with single blanks."""
    text = re.sub(r"<style.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(text).split())


def check(worst=3.2e-10, subject="P3", kind="position", method="step"):
    values = {"kind": kind, "subject": subject, "method": method, "worst": worst, "rms": 1e-10}
    reason = "a twentieth of what a link 0.1 % long does"
    return ms.Check(unit="m", instant=1.2, tolerance=1e-9, reason=reason, **values)


BROKEN = (check(), check(float("nan"), "P2", "velocity"))
PASSED = {"passed": True, "outcome": "passed", "checks": [plain(check())], "steps": 1000}
PASSED |= {"seconds": np.float64(1.25)}
FAILED = {"passed": False, "outcome": "diverged", "reason": "MuJoCo warned"}
FAILED |= {"checks": [plain(item) for item in BROKEN]}


def written(folder, *sections, notes=(), **mechanisms):
    """Return the path of a report on these results, with these sections."""
    passed = all(item["passed"] for item in mechanisms.values())
    results = {"passed": passed, "mechanisms": mechanisms}
    return report.write_report(folder, results, sections, notes=notes)


def page_of(folder, *sections, **more):
    """Return the text of a report."""
    return written(folder, *sections, **more).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def section():
    linkage = ms.catalog.make("rssr")
    motion = linkage.solve(ANGLES, 60.0)
    facts = {"mobility": 1, "crank_range": "full turn", "links": ["crank", "coupler"], "slack": {"a": 1e-9}}
    plots = [
        ("Motion", ms.plots.drawn(ms.plots.motion_plot(motion))),
        ("Paths", ms.plots.drawn(ms.plots.coupler_curve(linkage.mechanism, motion), "png")),
    ]
    settings = {"integrator": "RK4", "timestep": 1e-4}
    shown = {"facts": facts, "picture": PNG, "plots": plots, "checks": (check(),), "settings": settings}
    return report.Section(name="rssr", title="Spatial four-bar", **shown)


@pytest.mark.long
def test_the_page_is_self_contained(section, tmp_path):
    page = page_of(tmp_path, section, rssr=PASSED)
    links = re.findall(r'\s(?:src|href|srcset|poster|data)="([^"]*)', page)
    assert all(link.startswith(("data:", "#")) or link == "validate.json" for link in links)
    assert sum(link.startswith("data:image/") for link in links) == 2
    assert len(re.findall(r"url\(data:image/png;base64,", page)) == 1
    assert "@import" not in page
    assert not re.search(r"url\((?!data:)", page)


@pytest.mark.long
def test_failed_mechanisms_come_first_with_their_cause_and_failed_checks(section, tmp_path):
    cause = "rod = 0.199 m instead of 0.2 m, explains 100 % of the error"
    failed = FAILED | {"reason": "disagrees with rod.py:short", "findings": [{"message": cause}]}
    other = report.Section(name="other", checks=BROKEN)
    notes = ["no pictures: install libegl1"]
    page = page_of(tmp_path, section, other, notes=notes, rssr=PASSED, other=failed)
    assert page.index('<section id="other"') < page.index('<section id="rssr"')
    assert re.findall(r'<details class="case"( open)?>', page) == [" open", ""]
    first_screen = page[: page.index("<section")]
    order = ["Validation failed", "Failed checks and errors", failed["reason"], f"cause:</strong> {cause}"]
    assert sorted(order, key=first_screen.index) == order
    assert "velocity of P2" in first_screen
    assert notes[0] in first_screen
    assert page.index(cause, page.index('<section id="other"')) < page.index("<h3>Verdict")
    assert "not a number at 68.8°, tolerance 1 nm" in text_in(page)


def test_a_passed_file_with_findings_is_marked_and_lists_all(section, tmp_path):
    listed = [
        {"message": "loop is soft", "severity": "warning", "line": 7, "file": "", "remedy": "solref 0.002"},
        {"message": "hip collides", "severity": "warning", "line": 9, "file": "leg.xml", "remedy": "exclude"},
        {"message": "repeated rows", "severity": "note", "line": None, "file": "", "remedy": ""},
    ]
    for findings, verdict in ((listed, "passed, 2 findings"), (listed[2:], "passed")):
        page = page_of(tmp_path, section, rssr=PASSED | {"findings": findings})
        assert f"<h1>Validation {verdict}</h1>" in page
        assert ('class="verdict some"' in page) == (len(findings) > 1)
        text = text_in(page)
        for finding in findings:
            position = "" if finding["line"] is None else f"line {finding['line']}: "
            assert f"{position}{finding['message']}" in text
            assert finding["remedy"] in text


def test_the_numbers_are_written_as_json_next_to_the_page(section, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["mechsim", "validate"])
    written(tmp_path, section, rssr=PASSED, other=FAILED)
    numbers = json.loads((tmp_path / "validate.json").read_text(encoding="utf-8"))
    assert numbers["passed"] is False
    assert numbers["mechanisms"]["rssr"]["checks"][0]["worst"] == 3.2e-10
    assert numbers["mechanisms"]["rssr"]["seconds"] == 1.25
    assert numbers["mechanisms"]["other"]["checks"][1]["worst"] is None
    assert numbers["about"]["command"] == "mechsim validate"
    assert {"mechsim", "python", "mujoco", "numpy"} <= set(numbers["about"]["versions"])


def test_the_tightest_check_of_each_kind_comes_first(section, tmp_path):
    points = {"P2": 1e-10, "P3": 7e-10, "P4": 2e-10}
    checks = [check(worst, name) for name, worst in points.items()]
    failed = check(5e-9, "P5")
    for subset, first in ((checks, ["P3"]), ([*checks, failed], ["P3", "P5"])):
        shown = replace(section, checks=subset)
        page = page_of(tmp_path, shown, rssr=PASSED | {"passed": len(first) == 1})
        short, long = page[page.index("<section") :].split("<summary>All")
        assert [name for name in ("P2", "P3", "P4", "P5") if f"position of {name}" in short] == first
        assert all(f"position of {name}" in long for name in points)
        assert f" {len(subset)} quantities" in long


def test_names_are_escaped(tmp_path):
    section = report.Section(name="rssr", title="<script>alert(1)</script>", facts={"<b>": "<i>"})
    page = page_of(tmp_path, section, rssr=PASSED)
    tags = tags_in(page)
    assert {"b", "i"}.isdisjoint(tags)
    assert tags.count("script") == 1
    assert "alert(1)</script>" not in page


SURVEY = """(async () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
  scrollTo(0, 0);
  const images = [...document.images];
  await Promise.all(images.map(image => image.decode().catch(() => 0)));
  const texts = [...document.querySelectorAll("td, th, dd, dt, p, h2, h3, li")];
  const seen = texts.filter(one => one.getClientRects().length && !one.closest(".scroll"));
  return {
    images: images.length, across: document.documentElement.scrollWidth,
    bare: images.filter(image => !image.complete || image.naturalWidth === 0).length,
    cut: seen.filter(one => one.getBoundingClientRect().right > innerWidth + 1).map(one => one.textContent),
    smallest: Math.min(...seen.map(one => parseFloat(getComputedStyle(one).fontSize))),
  };
})()"""


@pytest.mark.slow
@in_browser
def test_a_browser_displays_everything_without_errors(section, tmp_path):
    page = written(tmp_path / "out", section, rssr=PASSED, other=FAILED)
    with Browser(tmp_path / "profile") as browser:
        for width, scheme in ((1280, "light"), (400, "dark")):
            browser.open(page, width, scheme)
            computed = browser.run(SURVEY)
            assert browser.complaints == []
            assert computed["bare"] == 0
            assert computed["images"] == 2
            assert computed["cut"] == []
            assert computed["across"] <= width
            assert computed["smallest"] >= 12.0
            observed = browser.look()
            assert observed.shape[1] == width
            paper, ink = observed[3, 3], observed[: observed.shape[0] // 3].reshape(-1, 3)
            assert (paper > 225).all() if scheme == "light" else (paper < 60).all()
            assert ink.min() < 60 < 225 < ink.max()
            assert len(np.unique(observed.reshape(-1, 3), axis=0)) > 100


@in_browser
def test_a_report_of_31_mechanisms_is_small_and_prints_on_four_pages(section, tmp_path):
    noise = np.random.default_rng(5).integers(0, 256, 25_000, dtype=np.uint8).tobytes()
    pictures = [PNG + noise[:-i] for i in range(1, 32)]
    checks = tuple(check(1e-12 * i, f"P{i}") for i in range(1, 30))
    sections = [
        replace(section, name=f"m{i}", title=f"m{i}", picture=picture, checks=checks, plots=[("Paths", PNG)])
        for i, picture in enumerate(pictures)
    ]
    page = written(tmp_path, *sections, **dict.fromkeys((item.name for item in sections), PASSED))
    assert page.stat().st_size < 3_000_000
    assert 1 <= sheets_of(page) <= 4


@in_browser
def test_filter_sort_and_links_select_a_row(section, tmp_path):
    other = replace(section, name="other", title="other", checks=(check(7e-10, "toe"), check(1e-10, "knee")))
    page = written(tmp_path, section, other, rssr=PASSED, other=PASSED)
    with Browser(tmp_path / "profile") as browser:
        browser.open(page, 400, "light", "#other.1")
        assert browser.run("document.getElementById('other.1').getClientRects().length") > 0
        assert browser.run("document.querySelectorAll('details.case[open]').length") == 1
        typed = "filter.value = 'position knee'; filter.dispatchEvent(new Event('input'));"
        hidden = "[...document.querySelectorAll('#cases > section')].map(one => one.hidden)"
        assert browser.run(f"(() => {{ {typed} return {hidden}; }})()") == [True, False]
        order = "order.value = 'worst'; order.dispatchEvent(new Event('change'));"
        names = "[...document.querySelectorAll('#cases > section')].map(one => one.id)"
        assert browser.run(f"(() => {{ {order} return {names}; }})()") == ["other", "rssr"]
        assert browser.complaints == []
