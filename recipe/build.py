"""Builds the package of conda, as rattler-build does: python recipe/build.py FOLDER [CHANNEL ...]."""

import sys
from pathlib import Path

from rattler_build import Stage0Recipe

recipe = Stage0Recipe.from_file(Path(__file__).with_name("recipe.yaml"))
for result in recipe.run_build(output_dir=sys.argv[1], channels=sys.argv[2:] or None):
    print(*result.packages)
