"""Each setting declares its description, default, valid values, option and table row."""

from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from mechsim.cli.command import command as declare
from mechsim.cli.simulate import simulate
from mechsim.errors import InputError
from mechsim.simulation import Settings, settings

FIELDS = fields(Settings)
VALUES = {
    "integrator": "Euler",
    "steps-per-turn": "50",
    "solref": "0.01,1",
    "solimp": "0.9,0.99",
    "compliance": "0.1",
}


def command(function) -> typer.Typer:
    app = typer.Typer()
    app.command()(function)
    return app


@pytest.mark.parametrize("item", FIELDS, ids=lambda item: item.name)
def test_each_setting_has_a_description_and_a_valid_default(item) -> None:
    assert item.metadata["about"].endswith(".")
    assert getattr(replace(Settings(), **{item.name: item.default}), item.name) == item.default


@pytest.mark.parametrize(
    "item", [item for item in FIELDS if not isinstance(item.default, bool)], ids=lambda item: item.name
)
def test_every_setting_rejects_invalid_values_in_one_line(item) -> None:
    for wrong in ("none of them", np.nan, -1.0, (np.nan, 1.0)):
        with pytest.raises(InputError) as reported:
            Settings(**{item.name: wrong})
        assert "\n" not in str(reported.value)
        assert str(wrong) in str(reported.value)


def test_the_command_has_exactly_the_declared_options() -> None:
    reported = CliRunner().invoke(command(simulate), ["--help"], terminal_width=200).output
    for item in FIELDS:
        option = f"--{item.name.replace('_', '-')}"
        assert (option in reported) == ("doc" in item.metadata)
    assert {f"--{name}" for name in VALUES} <= set(reported.split())


@pytest.mark.parametrize("name", VALUES)
def test_only_options_on_the_command_line_reach_the_command(name) -> None:
    computed = {}

    @declare
    def record(options: Annotated[dict[str, Any], Settings]) -> None:
        computed.update(options)

    result = CliRunner().invoke(command(record), [f"--{name}", VALUES[name]])
    assert result.exit_code == 0
    field = name.replace("-", "_")
    assert set(computed) == {field}
    assert getattr(Settings(**computed), field) != getattr(Settings(), field)


def test_a_declared_setting_has_an_option_a_check_and_a_row() -> None:
    @dataclass(frozen=True)
    class More(Settings):
        noise: float = settings.number_setting(
            1.0, "Noise.", doc="How loud.", row=("noise", "{:g} dB".format)
        )

    assert More().rows() == Settings().rows() | {"noise": "1 dB"}
    with pytest.raises(InputError, match=r"noise is -2\.0; give a finite number above 0"):
        More(noise=-2.0)

    @declare
    def loud(options: Annotated[dict[str, Any], More]) -> None:
        typer.echo(f"{More(**options).noise:g}")

    assert "How loud." in CliRunner().invoke(command(loud), ["--help"]).output
    assert CliRunner().invoke(command(loud), ["--noise", "3"]).output == "3\n"
