"""Measured tables: compared within a tolerance, fitted with standard deviations, read alike by both."""

import numpy as np
import pytest

import mechsim as ms
from mechsim import files

ANGLES = np.linspace(0.1, 6.2, 60)
SIGMA = 2e-5
COLUMNS = ("A.x", "A.y", "B.x")


def measured(**changed):
    """Return a table of positions of a slider-crank with normal errors of 20 um."""
    random = np.random.default_rng(1)
    motion = ms.catalog.make("slider_crank", **changed).solve(ANGLES)
    table = {"angle": ANGLES}
    for column in COLUMNS:
        point, axis = column.split(".")
        values = motion.points[point].position[:, "xyz".index(axis)]
        table[column] = values + SIGMA * random.standard_normal(len(ANGLES))
    return table


def written(path, table):
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*table.values(), strict=True)]
    path.write_text("\n".join([",".join(table), *rows]) + "\n")
    return path


def validated(path, **options):
    return ms.validate("slider_crank", against=path, stepped=False, **options)


@pytest.mark.long
def test_a_tolerance_above_the_noise_passes_and_one_below_it_names_the_short_rod(tmp_path):
    path = written(tmp_path / "short.csv", measured(rod=0.1999))
    assert validated(path, tolerance=2.5e-4).passed
    result = validated(path, tolerance=8e-5)
    assert not result.passed
    assert (result.findings[0].kind, result.findings[0].object) == ("dimension", "rod")
    assert result.findings[0].value == pytest.approx(-5e-4, rel=0.05)


@pytest.mark.long
def test_fit_and_validate_read_a_table_equally(tmp_path):
    table = measured(rod=0.1999)
    scaled = {f"{name} [mm]": 1e3 * values for name, values in table.items() if name != "angle"}
    scaled |= {"angle [deg]": np.rad2deg(table["angle"])}
    path = written(tmp_path / "mm.csv", scaled)
    fitted = ms.fit("slider_crank", files.read(path), ["rod"])
    cause = validated(path).findings[0]
    assert fitted.values["rod"] == pytest.approx(
        ms.fit("slider_crank", table, ["rod"]).values["rod"], abs=1e-12
    )
    assert fitted.values["rod"] - 0.2 == pytest.approx(0.2 * cause.value, rel=0.02)
    with pytest.raises(ms.InputError, match=r"'B\.x \[inchworm\]', whose unit does not suit"):
        ms.fit("slider_crank", {"angle": [0.0, 1.0], "B.x [inchworm]": [1.0, 2.0]}, ["rod"])
