import pytest

from mechsim.errors import InputError
from mechsim.numerics import resources


def test_what_fits_is_let_through_and_what_does_not_is_reported_with_figures_and_what_would(monkeypatch):
    monkeypatch.setattr(resources, "available_memory", lambda: 2e9)
    resources.require_memory("1,000 rows", 1_000, 8.0)
    with pytest.raises(InputError, match=r"8 GB of memory, and 2 GB are available; take 250,000,000"):
        resources.require_memory("a billion rows", 1e9, 8.0)
    with pytest.raises(InputError, match=r"take fewer turns: 250,000,000 instants"):
        resources.require_memory("a billion rows", 1e9, 8.0, "take fewer turns: {most} instants")


def test_a_container_has_no_more_than_its_share(monkeypatch, tmp_path):
    (tmp_path / "info").write_text("MemTotal: 9 kB\nMemAvailable:    8000000 kB\n")
    (tmp_path / "max").write_text("3000000000\n")
    (tmp_path / "taken").write_text("1000000000\n")
    monkeypatch.setattr(resources, "PROCESS", tmp_path / "info")
    monkeypatch.setattr(resources, "GROUPS", [])
    assert resources.available_memory() == resources.MAX_FRACTION * 8.192e9
    monkeypatch.setattr(resources, "GROUPS", [(tmp_path / "max", tmp_path / "taken")])
    assert resources.available_memory() == resources.MAX_FRACTION * 2e9
    (tmp_path / "max").write_text("max\n")
    assert resources.available_memory() == resources.MAX_FRACTION * 8.192e9


def test_a_limit_of_the_address_space_counts(monkeypatch, tmp_path):
    resource = pytest.importorskip("resource")
    (tmp_path / "info").write_text("MemAvailable:    8000000 kB\n")
    (tmp_path / "own").write_text("1000 500 1 1 0 1 0\n")
    monkeypatch.setattr(resources, "PROCESS", tmp_path / "info")
    monkeypatch.setattr(resources, "GROUPS", [])
    monkeypatch.setattr(resources, "OWN", tmp_path / "own")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (5e9, 5e9))
    left = 5e9 - 1000 * resources.os.sysconf("SC_PAGE_SIZE")
    assert resources.available_memory() == resources.ADDRESSABLE * left
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    assert resources.available_memory() == resources.MAX_FRACTION * 8.192e9
