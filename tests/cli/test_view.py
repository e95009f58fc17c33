import re
import webbrowser
from pathlib import Path

import pytest
from model_files import model_text

from mechsim.cli import app, exit_codes


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def run(*arguments):
    return app(["view", *arguments], standalone_mode=False)


def test_without_a_browser_the_page_is_written_to_the_folder(folder, capsys):
    run("four_bar")
    assert capsys.readouterr().out == "no browser on this machine; wrote four_bar.view.html\n"
    assert [path.name for path in folder.iterdir()] == ["four_bar.view.html"]


@pytest.mark.long
def test_a_page_that_reads_its_model_several_times_states_each_note_once(mechsim):
    text = model_text("planar_linkage_sim.json")
    Path("a.json").write_text(text.replace('"coupler_points":', '"seen": 1, "coupler_points":'))
    err = mechsim("view", "a.json", "--live", "-o", "a.html").err
    lines = [line for line in err.splitlines() if line.endswith("is not read")]
    assert lines
    assert len(lines) == len(set(lines))


def test_a_browser_opens_the_page_and_no_file_remains(folder, monkeypatch, capsys):
    opened = []
    monkeypatch.setenv("BROWSER", "any")
    monkeypatch.setattr(
        webbrowser, "get", lambda: type("B", (), {"open": staticmethod(lambda a: opened.append(a) or True)})
    )
    run("four_bar")
    assert capsys.readouterr().out.startswith("opened ")
    assert "four_bar.view.html" in opened[0]
    assert list(folder.iterdir()) == []


@pytest.mark.long
def test_links_of_a_file_that_are_not_drawn_are_named(folder, capsys):
    """Only the rocker has a geom, then no link; a geom in the hidden group 3 is not drawn."""
    text = (Path(__file__).parents[2] / "models/four_bar.xml").read_text()
    assert "<geom" not in text
    file = folder / "f.xml"
    for geoms, note in (
        ({}, "no moving link has a geom"),
        ({"rocker": 0}, "no visible geom on crank, coupler:"),
        ({"rocker": 0, "coupler": 3}, "no visible geom on crank, coupler:"),
        ({"rocker": 0, "coupler": 0, "crank": 0}, ""),
    ):
        drawn = text
        for link, group in geoms.items():
            drawn = re.sub(
                f'<body name="{link}"[^>]*>', rf'\g<0><geom size=".004" group="{group}" mass="0"/>', drawn
            )
        file.write_text(drawn)
        exit_codes.notes.clear()
        run("f.xml", "-o", "f.html")
        assert (note in " ".join(exit_codes.notes)) if note else not exit_codes.notes
