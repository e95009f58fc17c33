"""The fields of a dataclass declare command-line options with defaults and validation."""

from dataclasses import MISSING, dataclass, fields
from typing import ClassVar

import pytest
import typer
from typer.testing import CliRunner

import mechsim as ms
from mechsim import cli
from mechsim.cli.command import Stated, command
from mechsim.files import plain
from mechsim.pictures.render.look import changed
from mechsim.units import option, parse_length, parse_names


@dataclass(frozen=True)
class Cut:
    depth: float = option(0.002, "How deep.", unit="m", text="2mm")
    sides: tuple[str, ...] = option((), "Which sides.", read=parse_names)
    holes: tuple[float, ...] = option((), "Each hole's width.", read=parse_length, many=True, name="--hole")
    wet: bool = option(False, "Whether with water.")
    turns: int | None = option(None, "How many turns.")
    secret: str = "kept"


def run_cut(*arguments):
    """Return the arguments that a command receives and its output."""
    received = []

    @command
    def function(name: str, how: Cut) -> None:
        received.append((name, how))

    app = typer.Typer(rich_markup_mode=None)
    app.command()(function)
    output = CliRunner().invoke(app, ["it", *arguments])
    if isinstance(output.exception, ms.InputError):
        raise output.exception
    return (received[0] if received else None), output.output


def test_omitted_options_have_the_defaults_of_the_dataclass():
    assert run_cut()[0] == ("it", Cut())


def test_text_is_converted_to_quantities_names_numbers_and_flags():
    args = ("--depth", "3 mm", "--sides", "a,b", "--hole", "1mm", "--hole", "2mm", "--wet", "--turns", "4")
    assert run_cut(*args)[0] == ("it", Cut(0.003, ("a", "b"), (0.001, 0.002), True, 4))


def test_a_quantity_of_the_wrong_kind_is_rejected_with_its_option():
    with pytest.raises(ms.InputError, match="--depth '3 s' has unit 's'"):
        run_cut("--depth", "3 s")


def test_help_shows_exactly_the_declared_fields():
    output = run_cut("--help")[1]
    for word in ("--depth", "How deep.", "2mm", "--hole", "--wet"):
        assert word in output
    assert "secret" not in output


def test_every_documented_field_of_look_is_an_option_of_render():
    shown = {parameter.name for parameter in cli.load_command("render").params}
    assert {field.name for field in fields(ms.Look) if "doc" in field.metadata} <= shown


def test_an_unknown_field_of_look_is_rejected():
    with pytest.raises(ms.InputError, match="a picture has no option 'colour'; choose from size, camera"):
        changed(None, {"colour": "red"})
    assert changed(ms.Look(camera="top"), {"labels": False}) == ms.Look(camera="top", labels=False)


def test_the_default_of_a_parameter_declares_an_option():
    depths = []

    @command
    def function(
        depth: float = option(MISSING, "How deep.", unit="m"),
        sides: tuple[str, ...] = option((), "Which sides.", read=parse_names, name="--side"),
    ) -> None:
        depths.append((depth, sides))

    app = typer.Typer(rich_markup_mode=None)
    app.command()(function)
    for words in (["--depth", "3mm"], ["--depth", "3mm", "--side", "a,b"]):
        assert CliRunner().invoke(app, words).exit_code == 0
    assert depths == [(0.003, ()), (0.003, ("a", "b"))]
    assert CliRunner().invoke(app, []).exit_code == 2
    assert isinstance(CliRunner().invoke(app, ["--depth", "3s"]).exception, ms.InputError)


@dataclass(frozen=True)
class Measured:
    JSON: ClassVar[tuple[str, ...]] = ("width=extent", "passed")

    extent: float
    samples: tuple[float, ...] = ()

    @property
    def passed(self) -> bool:
        return self.extent < 1.0


def test_a_record_prints_its_listed_fields():
    assert plain(Measured(0.5)) == {"width": 0.5, "passed": True}


def test_only_stated_options_are_excluded():
    stated = Stated({"speed": "--speed"})
    stated.exclude(["samples"], "in a run")
    with pytest.raises(ms.InputError, match="--speed has no effect in a run"):
        stated.exclude(["samples", "speed"], "in a run")
