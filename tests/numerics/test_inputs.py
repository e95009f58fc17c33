import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.numerics import resources
from mechsim.numerics.arrays import number, numbers, require, units_remedy


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.array(2), True + True])
def test_a_real_number_is_returned_unchanged(value):
    assert number(value) == 2.0


@pytest.mark.parametrize("value", ["2", None, [2.0], 2j, object(), {}, np.array([1.0, 2.0])])
def test_other_values_become_nan(value):
    assert np.isnan(number(value))


def test_lists_of_numbers_keep_their_shape_and_ragged_lists_become_nan():
    assert numbers([[1, 2, 3]]).shape == (1, 3)
    assert numbers([]).shape == (0,)
    for value in ([[1], [1, 2]], ["a", 1], [None], "0:1"):
        assert np.isnan(numbers(value)).all()


def test_only_text_gets_a_hint_to_a_converter():
    assert "units.parse" in units_remedy("1um", "units.parse_length('1 um')")
    assert units_remedy(np.nan, "units.parse_length('1 um')") == ""


def test_an_array_of_objects_becomes_nan_unless_it_is_empty():
    assert numbers(np.array([], dtype=object)).shape == (0,)
    for objects in (
        np.array([2.0], dtype=object),
        np.array([2.0, 3.0], dtype=object),
        np.array([], dtype=str),
    ):
        result = numbers(objects)
        assert result.shape == ()
        assert np.isnan(result)


def test_a_value_of_the_type_is_returned_and_another_type_is_named():
    assert require("the count", 3, int) == 3
    with pytest.raises(InputError, match=r"^the count is of type str; give one of type int$"):
        require("the count", "3", int)


def test_work_above_the_memory_limit_is_rejected_with_a_remedy(monkeypatch):
    monkeypatch.setattr(resources, "available_memory", lambda: 2e9)
    resources.require_memory("1,000 rows", 1_000, 8.0)
    with pytest.raises(InputError, match=r"8 GB of memory, and 2 GB are available; use 250,000,000"):
        resources.require_memory("a billion rows", 1e9, 8.0)
    with pytest.raises(InputError, match=r"take fewer turns: 250,000,000 instants"):
        resources.require_memory("a billion rows", 1e9, 8.0, "take fewer turns: {most} instants")


def test_a_container_limits_the_available_memory(monkeypatch, tmp_path):
    (tmp_path / "info").write_text("MemTotal: 9 kB\nMemAvailable:    8000000 kB\n")
    (tmp_path / "max").write_text("3000000000\n")
    (tmp_path / "taken").write_text("1000000000\n")
    monkeypatch.setattr(resources, "MEMORY_INFO", tmp_path / "info")
    monkeypatch.setattr(resources, "CONTAINER_MEMORY", [])
    assert resources.available_memory() == resources.MAX_FRACTION * 8.192e9
    monkeypatch.setattr(resources, "CONTAINER_MEMORY", [(tmp_path / "max", tmp_path / "taken")])
    assert resources.available_memory() == resources.MAX_FRACTION * 2e9
    (tmp_path / "max").write_text("max\n")
    assert resources.available_memory() == resources.MAX_FRACTION * 8.192e9


def test_a_limit_of_the_address_space_limits_the_available_memory(monkeypatch, tmp_path):
    resource = pytest.importorskip("resource")
    (tmp_path / "info").write_text("MemAvailable:    8000000 kB\n")
    (tmp_path / "own").write_text("1000 500 1 1 0 1 0\n")
    monkeypatch.setattr(resources, "MEMORY_INFO", tmp_path / "info")
    monkeypatch.setattr(resources, "CONTAINER_MEMORY", [])
    monkeypatch.setattr(resources, "PROCESS_MEMORY", tmp_path / "own")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (5e9, 5e9))
    free = 5e9 - 1000 * resources.os.sysconf("SC_PAGE_SIZE")
    assert resources.available_memory() == resources.MAX_ADDRESS_FRACTION * free
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    assert resources.available_memory() == resources.MAX_FRACTION * 8.192e9
