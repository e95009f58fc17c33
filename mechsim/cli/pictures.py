"""Commands that draw: render, plot."""

from typing import Annotated

import typer

from mechsim.cli.options import Name, Output, Sets, Speed, drive_of, speed_of, writable


def render(name: Name, sets: Sets = None) -> None:
    """Draw."""


def plot(name: Name, sets: Sets = None) -> None:
    """Plot."""
