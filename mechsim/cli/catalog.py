"""Command `mechsim list`: what the catalogue and the gallery hold."""

from mechsim.analytic import catalog
from mechsim.cli.options import Json
from mechsim.cli.output import print_json, print_table
from mechsim.subjects import gallery


def list_mechanisms(as_json: Json = False) -> None:
    """List the mechanisms of the catalogue and of the gallery."""
    described = {name: (drive.__doc__ or "").splitlines()[0] for name, drive in catalog.DRIVES.items()}
    shown = {name: gallery.description(path) for name, path in gallery.files().items()}
    if as_json:
        print_json({"mechanisms": described, "gallery": shown})
        return
    print_table("The catalogue", ("name", "what it is"), described.items())
    print_table(f"The gallery, in {gallery.folder()}", ("name", "what it is"), shown.items())
