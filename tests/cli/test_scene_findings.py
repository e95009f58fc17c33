"""Commands report findings of a scene with faults, and none of a valid one."""

from valid_scene import SOUND

from mechsim.errors import InputError

DRIVEN = ("--drive", "crank=0.3*sin(2*pi*t)", "--duration", "0.1")


def test_a_late_rejection_writes_no_file(mechsim, file, tmp_path, monkeypatch):
    def reject(*_):
        raise InputError("no")

    for function in ("scene_findings", "loss_of_significance"):
        with monkeypatch.context() as patched:
            patched.setattr(f"mechsim.cli.simulate.{function}", reject)
            code, _, err = mechsim("simulate", file(SOUND), *DRIVEN, "-o", "run.csv")
        assert (code, err) == (2, "mechsim: no\n")
        assert not (tmp_path / "run.csv").exists()
