"""A sweep from call to file: output and rejected input."""

import numpy as np
import pytest
import xarray

import mechsim as ms
from mechsim.errors import InputError, OutputError, install_command
from mechsim.studies.sweep import sweeping

VARY = {"crank": np.linspace(0.02, 0.06, 5), "coupler": np.linspace(0.03, 0.1, 4)}
MEASURES = ["range:rocker", "max:C.x"]


@pytest.mark.long
def test_a_written_sweep_reads_back(tmp_path):
    path = tmp_path / "out.nc"
    result = ms.sweep("four_bar", VARY, MEASURES, output=path)
    read_back = xarray.open_dataset(path)
    np.testing.assert_array_equal(read_back["range:rocker"], result["range:rocker"])
    np.testing.assert_array_equal(read_back["crank"], result["crank"])
    assert read_back["reason"].values.tolist() == result["reason"].values.tolist()
    assert read_back["range:rocker"].dims == ("crank", "coupler")
    assert [item.name for item in tmp_path.iterdir()] == [path.name]
    assert read_back["range:rocker"].attrs["units"] == "rad"
    assert read_back.attrs["model"] == "four_bar"
    assert read_back["crank"].attrs["units"] == "m"


def test_an_interrupted_sweep_leaves_no_file(tmp_path, monkeypatch):
    def interrupt(_, fraction):
        if fraction > 0.5:
            raise KeyboardInterrupt

    monkeypatch.setattr(sweeping, "BY_FORMULA", 4)
    with pytest.raises(KeyboardInterrupt):
        ms.sweep("four_bar", VARY, MEASURES, output=tmp_path / "out.nc", progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_what_netcdf_cannot_write_keeps_the_earlier_table(tmp_path, monkeypatch):
    def full(*_, **__):
        raise RuntimeError("NetCDF: HDF error")

    path = tmp_path / "out.nc"
    path.write_text("earlier")
    monkeypatch.setattr(xarray.Dataset, "to_netcdf", full)
    with pytest.raises(OutputError, match="HDF error; is the disk full"):
        ms.sweep("four_bar", VARY, MEASURES, output=path)
    assert path.read_text() == "earlier"


def test_short_chunks_give_the_table_of_one_chunk(monkeypatch):
    whole = ms.sweep("four_bar", VARY, MEASURES)
    monkeypatch.setattr(sweeping, "BY_FORMULA", 3)
    for name in ("range:rocker", "max:C.x", "outcome"):
        np.testing.assert_array_equal(ms.sweep("four_bar", VARY, MEASURES)[name], whole[name])


def test_designs_beyond_memory_are_rejected(monkeypatch):
    monkeypatch.setattr("mechsim.numerics.resources.available_memory", lambda: 1000.0)
    with pytest.raises(InputError, match="fit"):
        ms.sweep("four_bar", VARY, MEASURES)


def test_a_missing_library_is_reported_with_its_install_command(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(ms.MechsimError) as caught:
        ms.sweep("four_bar", VARY, MEASURES)
    assert str(caught.value).startswith(f"xarray is not installed; {install_command('sweep')}")
