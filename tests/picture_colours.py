"""Hues of pictures."""

from colorsys import rgb_to_hsv

import numpy as np


def hues(picture):
    """Return hue (0 to 1) and saturation of every pixel."""
    colours = picture.reshape(-1, 3).astype(np.float64) / 255.0
    high, low = colours.max(1), colours.min(1)
    spread = np.where(high > low, high - low, 1.0)
    r, g, b = colours.T
    hue = np.select(
        [high == r, high == g], [((g - b) / spread) % 6.0, (b - r) / spread + 2.0], (r - g) / spread + 4.0
    )
    saturation = (high - low) / np.maximum(high, 1.0 / 255.0)
    return (hue / 6.0).reshape(picture.shape[:2]), saturation.reshape(picture.shape[:2])


def coloured(picture, rgba, least=0.25):
    """Return a mask of the pixels of a hue."""
    hue, saturation = hues(picture)
    expected = rgb_to_hsv(*rgba[:3])[0]
    distance = np.abs(hue - expected)
    return (np.minimum(distance, 1.0 - distance) < 0.035) & (saturation > least)
