"""A scene without findings, and variants with changed text."""

from model_files import model_text

# a four-bar with a ball joint, so that its loop has no redundant equation
SOUND = model_text("sound.xml")


def changed(*changes):
    """Return the text of the scene with replaced pieces, each of which occurs once."""
    text = SOUND
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text
