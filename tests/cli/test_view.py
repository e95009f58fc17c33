import os
import webbrowser

import pytest

from mechsim.cli import app
from mechsim.errors import InputError


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def run(*words):
    return app(["view", *words], standalone_mode=False)


def test_without_a_screen_the_page_is_written_here_and_that_is_stated(place, capsys):
    run("four_bar")
    assert capsys.readouterr().out == "no browser on this machine; wrote four_bar.view.html\n"
    assert [path.name for path in place.iterdir()] == ["four_bar.view.html"]


def test_a_browser_is_given_the_page_and_nothing_is_left_here(place, monkeypatch, capsys):
    given = []
    monkeypatch.setenv("BROWSER", "any")
    monkeypatch.setattr(
        webbrowser, "get", lambda: type("B", (), {"open": staticmethod(lambda a: given.append(a) or True)})
    )
    run("four_bar")
    assert capsys.readouterr().out.startswith("opened ")
    assert "four_bar.view.html" in given[0]
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("words", [("four_bar", "-o", "view.png"), ("four_bars", "-o", "view.html")])
def test_what_cannot_be_shown_is_rejected_and_nothing_written(place, words):
    with pytest.raises(InputError):
        run(*words)
    assert os.listdir(place) == []
