"""Settings declare all that is reported of them; what follows from that, for every one of them."""

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


@pytest.mark.parametrize("one", FIELDS, ids=lambda one: one.name)
def test_a_setting_states_what_it_is_and_keeps_its_default(one) -> None:
    assert one.metadata["about"].endswith(".")
    assert getattr(replace(Settings(), **{one.name: one.default}), one.name) == one.default


@pytest.mark.parametrize(
    "one", [one for one in FIELDS if not isinstance(one.default, bool)], ids=lambda one: one.name
)
def test_every_setting_rejects_what_is_none_of_its_values_in_one_line(one) -> None:
    for wrong in ("none of them", np.nan, -1.0, (np.nan, 1.0)):
        with pytest.raises(InputError) as told:
            Settings(**{one.name: wrong})
        assert "\n" not in str(told.value)
        assert str(wrong) in str(told.value)


def test_the_command_has_the_options_that_settings_declare_and_no_others() -> None:
    told = CliRunner().invoke(command(simulate), ["--help"], terminal_width=200).output
    for one in FIELDS:
        option = f"--{one.name.replace('_', '-')}"
        assert (option in told) == ("doc" in one.metadata)
    assert {f"--{name}" for name in VALUES} <= set(told.split())


@pytest.mark.parametrize("name", VALUES)
def test_what_is_written_and_nothing_else_reaches_the_command(name) -> None:
    found = {}

    @declare
    def asked_for(asked: Annotated[dict[str, Any], Settings]) -> None:
        found.update(asked)

    result = CliRunner().invoke(command(asked_for), [f"--{name}", VALUES[name]])
    assert result.exit_code == 0
    field = name.replace("-", "_")
    assert set(found) == {field}
    assert getattr(Settings(**found), field) != getattr(Settings(), field)


def test_a_setting_that_is_declared_is_an_option_a_rejection_and_a_row() -> None:
    @dataclass(frozen=True)
    class More(Settings):
        noise: float = settings.number_setting(
            1.0, "Noise.", doc="How loud.", row=("noise", "{:g} dB".format)
        )

    assert More().rows() == Settings().rows() | {"noise": "1 dB"}
    with pytest.raises(InputError, match=r"noise is -2\.0; give a finite number above 0"):
        More(noise=-2.0)

    @declare
    def loud(asked: Annotated[dict[str, Any], More]) -> None:
        typer.echo(f"{More(**asked).noise:g}")

    assert "How loud." in CliRunner().invoke(command(loud), ["--help"]).output
    assert CliRunner().invoke(command(loud), ["--noise", "3"]).output == "3\n"
