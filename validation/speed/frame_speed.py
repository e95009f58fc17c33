"""Cost of a frame next to that of a bare `mujoco.Renderer`, and of a whole video.

    python validation/speed/frame_speed.py [WIDTHxHEIGHT] [NAME...]

The script draws three scenes in turn, so that other load of the machine affects all equally. It prints
medians of processor and wall time:
- exported: the model that `mechsim export --scene picture` writes, in a bare renderer;
- drawn: the model of mechsim's frames, in a bare renderer: the solids, without shadow, paths or text;
- mechsim: a finished frame with shadow, growing paths, labels and read-out.
The ratio is that of mechsim to the exported scene, at most 1.2. The last column is a video of 240 frames.
"""

import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import mujoco
import numpy as np

from mechsim import catalog
from mechsim.model.scene import Scene
from mechsim.pictures import render
from mechsim.pictures.render import gl_backend
from mechsim.pictures.render.drawing import Source, draw
from mechsim.pictures.render.drawn_model import CAMERA
from mechsim.pictures.render.look import Look
from mechsim.simulation.mjcf import compiled
from mechsim.studies.export import exported

ROUNDS, FRAMES = 25, 240


def wall_and_cpu_time(action):
    wall, cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - wall, time.process_time() - cpu


def bare(stack, model, size, drawing_on):
    model.vis.global_.offwidth, model.vis.global_.offheight = size
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    drawing = stack.enter_context(gl_backend.renderer(model, size, drawing_on))

    def frame():
        drawing.update_scene(data, CAMERA)
        drawing.render()

    return frame


def row(name, size, drawing_on):
    closed_form = catalog.make(name)
    reach = closed_form.crank_range()
    ends = (0.0, 2.0 * np.pi) if reach.full else (reach.intervals[0][0] + 0.02, reach.intervals[0][1] - 0.02)
    motion = closed_form.solve(np.linspace(*ends, FRAMES + 1), 60.0)
    drawn = Source(closed_form.mechanism, motion).drawn(Look(size=size, paths="tail"))
    scene = compiled(exported(closed_form.mechanism, Scene(level="picture")))
    with ExitStack() as stack:
        # each renderer selects its own OpenGL context before it draws
        renderers = [bare(stack, model, size, drawing_on) for model in (scene, drawn.model)]
        frames = draw(drawn, drawing_on)
        stack.callback(frames.close)
        renderers.append(lambda: next(frames))
        for draw_frame in renderers:
            draw_frame()
        times = np.array([[wall_and_cpu_time(draw_frame) for draw_frame in renderers] for _ in range(ROUNDS)])
    wall, cpu = 1e3 * np.median(times, axis=0).T
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        angles = motion.angle[:-1]
        render.write_video(
            Path(folder) / "a.mp4", closed_form.mechanism, motion, angles=angles, size=size, paths="tail"
        )
        video_seconds = time.perf_counter() - start
    return wall, cpu, video_seconds


def main():
    sizes = [word for word in sys.argv[1:] if word[0].isdigit()]
    width, height = map(int, (sizes or ["1280x720"])[0].split("x"))
    names = [word for word in sys.argv[1:] if not word[0].isdigit()] or list(catalog.MECHANISMS)
    drawing_on = gl_backend.choose()
    print(f"{drawing_on}, {width}x{height}; ms of wall (processor) a frame")
    print(f"{'':14}{'exported':>14}{'drawn':>14}{'mechsim':>14}{'ratio':>8}{'240 frames':>14}")
    for name in names:
        wall, cpu, video_seconds = row(name, (width, height), drawing_on)
        columns = "".join(f"{a:8.1f} ({b:3.0f})" for a, b in zip(wall, cpu, strict=True))
        print(f"{name:14}{columns}{wall[2] / wall[0]:8.2f}{video_seconds:12.1f} s", flush=True)


if __name__ == "__main__":
    main()
