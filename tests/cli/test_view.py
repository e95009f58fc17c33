import os
import webbrowser

import pytest

from mechsim.cli import app
from mechsim.errors import InputError


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


@pytest.mark.parametrize("arguments", [("four_bar", "-o", "view.png"), ("four_bars", "-o", "view.html")])
def test_invalid_input_is_rejected_without_a_file(folder, arguments):
    with pytest.raises(InputError):
        run(*arguments)
    assert os.listdir(folder) == []
