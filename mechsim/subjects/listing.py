"""The mechanisms that come with mechsim, each with a one-sentence description."""

from mechsim.analytic import catalog
from mechsim.subjects import gallery


def list() -> dict[str, dict[str, str]]:
    """Return the mechanisms that come with mechsim: catalogue and gallery, name -> description.

    Example:
        >>> sorted(ms.list())
        ['gallery', 'mechanisms']
    """
    return {
        "mechanisms": {name: (cls.__doc__ or "").splitlines()[0] for name, cls in catalog.DRIVES.items()},
        "gallery": {name: gallery.description(path) for name, path in gallery.files().items()},
    }
