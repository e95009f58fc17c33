import pytest

from mechsim.errors import InputError
from mechsim.maths import memory


def test_what_fits_is_let_through_and_what_does_not_is_told_with_figures_and_what_would(monkeypatch):
    monkeypatch.setattr(memory, "room", lambda: 2e9)
    memory.require_room("1,000 rows", 1_000, 8.0)
    with pytest.raises(InputError, match=r"8 GB of memory, and 2 GB are to be had; take 250,000,000"):
        memory.require_room("a billion rows", 1e9, 8.0)
    with pytest.raises(InputError, match=r"take fewer turns: 250,000,000 instants"):
        memory.require_room("a billion rows", 1e9, 8.0, "take fewer turns: {most} instants")


def test_a_container_has_no_more_than_its_share(monkeypatch, tmp_path):
    (tmp_path / "info").write_text("MemTotal: 9 kB\nMemAvailable:    8000000 kB\n")
    (tmp_path / "max").write_text("3000000000\n")
    (tmp_path / "taken").write_text("1000000000\n")
    monkeypatch.setattr(memory, "PROCESS", tmp_path / "info")
    monkeypatch.setattr(memory, "GROUPS", [])
    assert memory.room() == memory.PART * 8.192e9
    monkeypatch.setattr(memory, "GROUPS", [(tmp_path / "max", tmp_path / "taken")])
    assert memory.room() == memory.PART * 2e9
    (tmp_path / "max").write_text("max\n")
    assert memory.room() == memory.PART * 8.192e9
