"""The path of a point far beyond the links is clipped, with a note in the picture."""

import numpy as np
import pytest
from model_files import model_text

from mechsim.pictures.render import Look
from mechsim.pictures.render.drawing import Source, legend, named
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.subjects.readers import load

ARM = model_text("clipped_paths_arm.xml")


@pytest.mark.parametrize("radius", [100.0, 0.3])
def test_a_picture_is_framed_on_the_links_and_notes_clipped_paths(tmp_path, radius):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.replace("FAR", str(radius)))
    solver = load(str(path), drive={"crank": "t"})
    motion = solver.solve(t=np.linspace(0.0, 1.0, 20))
    drawn = Source(solver.mechanism, motion).drawn(Look(**drawn_as(solver), arrows=("velocity",)))
    cut = radius > 1.0
    assert drawn.camera.height < 2.0 * max(0.2, 0.0 if cut else radius)
    assert drawn.camera.height > 0.1
    assert ("far" in named(drawn, 0)) == (not cut)
    assert "near" in named(drawn, 0)
    note = [line for line, _ in legend(drawn) if "framed on the links; cut: the path of far" in line]
    assert len(note) == cut
    # the clipped part lies outside the picture
    distance = np.abs(drawn.frames.paths["far"] - drawn.frames.paths["near"]).max()
    assert not cut or distance > 0.5 * drawn.camera.height
