import os
import threading
from pathlib import Path

import numpy as np
import pytest

from mechsim import catalog, files
from mechsim.errors import InputError, OutputError
from mechsim.numerics import resources


@pytest.fixture(scope="module")
def motion():
    return catalog.make("rssr").solve(np.linspace(0.0, 7.0, 5001), speed=62.8)


@pytest.mark.parametrize("extension", [".csv", ".npz", ".CSV"])
def test_a_table_round_trips_exactly(motion, tmp_path, extension):
    path = tmp_path / f"table{extension}"
    files.write(path, motion)
    table = files.read(path)
    assert list(table) == [name for name, _ in motion.columns()]
    for name, column in motion.columns():
        assert (table[name] == column).all()


def test_an_output_path_of_a_directory_is_rejected(motion, tmp_path):
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(OutputError, match="it is a directory"):
        files.write(tmp_path / "table.csv", motion)


def test_a_failed_write_keeps_only_the_old_file(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("old")

    def fail_while_writing():
        with files.atomic_path(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("the writer broke")

    with pytest.raises(RuntimeError):
        fail_while_writing()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_successful_write_replaces_the_file_with_default_permissions(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("old")
    with files.atomic_path(path) as temporary:
        assert temporary.suffix == ".html"
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


def test_writing_to_a_symbolic_link_writes_its_target(motion, tmp_path):
    (tmp_path / "there").mkdir()
    target, link, loop = tmp_path / "there" / "real.csv", tmp_path / "link.csv", tmp_path / "loop.csv"
    for _ in range(2):  # without, then with an existing target
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        files.write(link, motion)
        assert link.is_symlink()
        assert len(files.read(target)["angle"]) == len(motion)
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["real.csv"]
    loop.symlink_to(loop)
    with pytest.raises(OutputError, match="circle"):
        files.write(loop, motion)


def test_writing_to_a_named_pipe_keeps_the_pipe(motion, tmp_path):
    pipe, reported = tmp_path / "pipe.csv", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: reported.append(pipe.read_text()))
    reader.start()
    files.write(pipe, motion)
    reader.join()
    files.write(tmp_path / "plain.csv", motion)
    assert reported == [(tmp_path / "plain.csv").read_text()]
    assert pipe.is_fifo()
    (tmp_path / "full.csv").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="No space left"):
        files.write(tmp_path / "full.csv", motion)
    with pytest.raises(OutputError, match="No space left"):
        files.require_writable(tmp_path / "full.csv")
    files.require_writable("/dev/null")
    assert Path("/dev/full").is_char_device()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full.csv", "pipe.csv", "plain.csv"]


def test_a_read_only_file_is_rejected_and_permissions_are_kept(motion, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("mine")
    path.chmod(0o444)
    with pytest.raises(OutputError, match="read-only"):
        files.write(path, motion)
    assert path.read_text() == "mine"
    path.chmod(0o600)
    files.write(path, motion)
    assert path.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    "text", ["\ufefftime,angle\n0,1\n", "time, angle\n0, 1\n", " time ,angle\r\n0,1\r\n"]
)
def test_headers_of_spreadsheets_are_read(tmp_path, text):
    (tmp_path / "a.csv").write_text(text, encoding="utf-8", newline="")
    assert files.read(tmp_path / "a.csv") == {"time": [0.0], "angle": [1.0]}


def test_pipes_and_files_beyond_memory_are_rejected(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="no regular file"):
        files.read(tmp_path / "pipe.csv")
    np.savez_compressed(tmp_path / "bomb.npz", time=np.zeros(1_000_000))
    files.read(tmp_path / "bomb.npz")
    assert (tmp_path / "bomb.npz").stat().st_size < 20_000
    monkeypatch.setattr(resources, "available_memory", lambda: 20e6)
    with pytest.raises(InputError, match=r"bomb.npz holds would take 80 MB of memory, and 20 MB"):
        files.read(tmp_path / "bomb.npz")
    (tmp_path / "long.csv").write_text("time\n" + "0\n" * 2_000_000)
    with pytest.raises(InputError, match=r"long.csv holds would take 40 MB"):
        files.read(tmp_path / "long.csv")


def fill_and_fail(folder: Path, error: BaseException) -> None:
    """Write files into a folder, and fail before the end."""
    with files.atomic_folder(folder) as unfinished:
        for name in ("a.txt", "b.txt"):
            (unfinished / name).write_text("second")
        raise error


def test_files_of_a_folder_appear_together_and_an_error_keeps_the_earlier_ones(tmp_path):
    folder = tmp_path / "out"
    with files.atomic_folder(folder) as unfinished:
        (unfinished / "a.txt").write_text("first")
        assert not (folder / "a.txt").exists()
    for error, match in (
        (OSError(28, "No space left on device"), "No space left"),
        (KeyboardInterrupt(), None),
    ):
        with pytest.raises((OutputError, KeyboardInterrupt), match=match):
            fill_and_fail(folder, error)
    assert {path.name: path.read_text() for path in folder.iterdir()} == {"a.txt": "first"}
    with pytest.raises(ZeroDivisionError), files.atomic_folder(tmp_path / "new"):
        _ = 1 / 0
    assert not (tmp_path / "new").exists()


def test_a_second_writer_of_a_folder_is_rejected(tmp_path):
    with files.atomic_folder(tmp_path) as unfinished:
        (unfinished / "a.txt").write_text("first")
        with pytest.raises(OutputError, match="another process"), files.atomic_folder(tmp_path):
            pass
        assert (unfinished / "a.txt").exists()
    # what a killed process left there is not taken for a result
    (tmp_path / ".unfinished").mkdir()
    (tmp_path / ".unfinished" / "b.txt").write_text("left")
    with files.atomic_folder(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
