"""A sweep from call to file: output, resuming and rejected input."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.errors import InputError, install_command
from mechsim.studies.sweep import chunks, sweeping
from mechsim.studies.sweep.sweeping import built
from mechsim.studies.sweep.table import read_sweep

VARY = {"crank": np.linspace(0.02, 0.06, 5), "coupler": np.linspace(0.03, 0.1, 4)}
MEASURES = ["range:rocker", "crank_range"]


@pytest.mark.long
@pytest.mark.parametrize("ending", ["nc", "parquet", "csv"])
def test_a_written_sweep_reads_back(tmp_path, ending):
    path = tmp_path / f"out.{ending}"
    result = ms.sweep("four_bar", VARY, MEASURES, output=path)
    read_back = read_sweep(path)
    np.testing.assert_array_equal(read_back["range:rocker"], result["range:rocker"])
    np.testing.assert_array_equal(read_back["crank"], result["crank"])
    assert read_back["reason"].values.tolist() == result["reason"].values.tolist()
    assert read_back["range:rocker"].dims == ("crank", "coupler")
    assert [item.name for item in tmp_path.iterdir()] == [path.name]
    if ending != "csv":
        assert read_back["range:rocker"].attrs["units"] == "rad"
        assert read_back.attrs["model"] == "four_bar"
        assert read_back["crank"].attrs["units"] == "m"


def stopped_after(monkeypatch, count):
    """Stop sweeps after this many chunks."""
    run = chunks.run_chunks

    def short(task, chunk_list, keep):
        run(task, chunk_list[:count], keep)
        raise KeyboardInterrupt

    monkeypatch.setattr(chunks, "BY_FORMULA", 4)
    monkeypatch.setattr(sweeping, "run_chunks", short)
    return run


@pytest.mark.parametrize("ending", ["nc", "parquet", "csv"])
def test_an_interrupted_sweep_resumes_to_the_same_file(tmp_path, monkeypatch, ending):
    whole, interrupted = tmp_path / f"whole.{ending}", tmp_path / f"cut.{ending}"
    run = stopped_after(monkeypatch, 2)
    with pytest.raises(KeyboardInterrupt):
        ms.sweep("four_bar", VARY, MEASURES, output=interrupted)
    assert not interrupted.exists()
    with pytest.raises(InputError, match="--resume"):
        ms.sweep("four_bar", VARY, MEASURES, output=interrupted)
    with pytest.raises(InputError, match="another sweep"):
        ms.sweep("four_bar", VARY, ["crank_range"], output=interrupted, resume=True)
    resumed = []
    monkeypatch.setattr(
        sweeping,
        "run_chunks",
        lambda task, chunk_list, *rest: resumed.append(chunk_list) or run(task, chunk_list, *rest),
    )
    ms.sweep("four_bar", VARY, MEASURES, output=interrupted, resume=True)
    assert [item[0] for item in resumed[0]] == [2, 3, 4]
    ms.sweep("four_bar", VARY, MEASURES, output=whole)
    assert interrupted.read_bytes() == whole.read_bytes()


def test_a_truncated_chunk_is_recomputed(tmp_path, monkeypatch):
    path = tmp_path / "out.nc"
    run = stopped_after(monkeypatch, 3)
    with pytest.raises(KeyboardInterrupt):
        ms.sweep("four_bar", VARY, MEASURES, output=path)
    chunk_file = next(path.with_name("out.nc.parts").glob("*1.npz"))
    chunk_file.write_bytes(chunk_file.read_bytes()[:100])
    monkeypatch.setattr(sweeping, "run_chunks", run)
    result = ms.sweep("four_bar", VARY, MEASURES, output=path, resume=True)
    np.testing.assert_array_equal(
        result["range:rocker"], ms.sweep("four_bar", VARY, MEASURES)["range:rocker"]
    )


def test_the_output_of_another_sweep_is_not_overwritten(tmp_path):
    path = tmp_path / "out.nc"
    result = ms.sweep("four_bar", VARY, MEASURES, output=path)
    before = path.read_bytes()
    assert built(ms.sweep("four_bar", VARY, MEASURES, output=path, resume=True)) == built(result)
    for other in ({"samples": 10}, {"speed": 2.0}, {"set": {"rocker": 0.08}}):
        with pytest.raises(InputError, match="contains another sweep"):
            ms.sweep("four_bar", VARY, MEASURES, output=path, **other)
    assert path.read_bytes() == before


def test_designs_beyond_memory_or_disk_are_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr("mechsim.numerics.resources.available_memory", lambda: 1000.0)
    with pytest.raises(InputError, match="fit"):
        ms.sweep("four_bar", VARY, MEASURES)
    monkeypatch.undo()
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("mechsim.studies.sweep.chunks.shutil.disk_usage", lambda _: usage)
    with pytest.raises(InputError, match=r"of disk, .* fit"):
        ms.sweep("four_bar", VARY, MEASURES, output=tmp_path / "out.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_library_is_reported_with_its_install_command(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(ms.MechsimError) as caught:
        ms.sweep("four_bar", VARY, MEASURES)
    assert str(caught.value).startswith(f"xarray is not installed; {install_command('sweep')}")
