"""Command `mechsim list`: what the catalogue holds."""

from mechsim.analytic import catalog
from mechsim.cli.options import Json
from mechsim.cli.output import print_json, print_table


def list_mechanisms(as_json: Json = False) -> None:
    """List the mechanisms of the catalogue."""
    described = {name: (drive.__doc__ or "").splitlines()[0] for name, drive in catalog.DRIVES.items()}
    if as_json:
        print_json({"mechanisms": described})
    else:
        print_table("The catalogue", ("name", "what it is"), described.items())
