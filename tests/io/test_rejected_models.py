"""Invalid changes of files of tests/models: one line that names the value and, if known, the line."""

import tomllib
from string import Template

import pytest
from model_files import FOLDER, model_text

import mechsim as ms

TABLES = tomllib.loads((FOLDER.parent / "rejected" / "models.toml").read_text(encoding="utf-8"))
VALUES = TABLES.pop("values")


@pytest.mark.parametrize(("model", "row"), [(model, row) for model, rows in TABLES.items() for row in rows])
def test_an_invalid_model_is_rejected_in_one_line(model, row, tmp_path):
    old, new, *words = row
    values, text = VALUES.get(model, {}), model_text(model)
    text = text if old in text else Template(text).substitute(values)
    assert old in text
    changed = text.replace(old, new, 1)
    path = tmp_path / model
    path.write_text(Template(changed).substitute(values) if values else changed)
    with pytest.raises(ms.MechsimError) as rejected:
        ms.load(str(path), still=True)
    message = str(rejected.value)
    assert "\n" not in message
    assert [word for word in words if word not in message] == []
