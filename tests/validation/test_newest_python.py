import sys

import newest_python


def test_the_newest_working_interpreter_is_selected(tmp_path):
    broken, old = tmp_path / "broken", tmp_path / "old"
    broken.write_text("#!/bin/sh\nexit 1\n")
    old.write_text("#!/bin/sh\necho 3.2.1\n")
    for interpreter in (broken, old):
        interpreter.chmod(0o755)
    interpreters = [str(broken), "/nowhere/python3", sys.executable, str(old)]
    assert newest_python.newest(interpreters) == sys.executable
    assert newest_python.version(str(broken)) == ()
    assert newest_python.version(str(old)) == (3, 2, 1)
    assert sys.executable in newest_python.candidates()
