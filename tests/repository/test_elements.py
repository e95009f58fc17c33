"""The pages of machine elements: each file agrees with its check, and its wrong input is rejected."""

import element_pages
import numpy as np
import pytest

import mechsim as ms

each_element = pytest.mark.parametrize("element", element_pages.elements(), ids=lambda element: element.name)


@each_element
def test_the_file_of_an_element_agrees_with_another_equation(element, tmp_path):
    file = tmp_path / f"{element.name}.toml"
    file.write_text(element.toml)
    assert "assert " in element.code
    exec(element.code, {"np": np, "ms": ms, "FILE": str(file), "model": ms.load(file, still=True)})


@each_element
def test_the_wrong_input_of_an_element_is_rejected_in_one_sentence(element, tmp_path):
    file = tmp_path / "wrong.toml"
    file.write_text(element.wrong_toml)
    assert element.wrong_toml != element.toml
    with pytest.raises(ms.InputError) as caught:
        ms.load(file, still=True)
    # it names the file and the remedy, in one line
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)
    assert ";" in str(caught.value)


def test_a_page_has_formula_source_picture_and_the_code_of_its_file():
    assert len(element_pages.elements()) >= 22
    for element in element_pages.elements():
        text = element_pages.page(element, "wrong.toml: no")
        assert f"$$ {element.law} $$" in text
        assert f"Source: {element.source}." in text
        assert f"pictures/elements/{element.name}.png" in text
        assert element.toml in text
    assert "element_pages.write" in (element_pages.ELEMENTS.parent / "conf.py").read_text()
