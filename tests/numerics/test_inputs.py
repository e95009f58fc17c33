import numpy as np
import pytest

from mechsim.errors import InputError
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
