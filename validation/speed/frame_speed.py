"""Cost of a frame next to that of a bare `mujoco.Renderer`, and of a whole video.

    python validation/speed/frame_speed.py [WIDTHxHEIGHT] [NAME...]

Three things are drawn in turn, so that what else the machine does falls on all alike; medians of processor
and wall time are printed:
- exported: the model that `mechsim export --scene picture` writes, in a bare renderer;
- stage: the model our frames are drawn from, in a bare renderer: the solids, without shadow, paths or text;
- ours: a finished frame with shadow, growing paths, labels and read-out.
The ratio asked for, at most 1.2, is that of ours to the exported scene. The last columns are a video of
240 frames.
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
from mechsim.simulation.mjcf import compiled, generate

ROUNDS, FRAMES = 25, 240


def measured(action):
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
    drive = catalog.make(name)
    turn = drive.crank_range()
    ends = (0.0, 2.0 * np.pi) if turn.full else (turn.intervals[0][0] + 0.02, turn.intervals[0][1] - 0.02)
    motion = drive.solve(np.linspace(*ends, FRAMES + 1), 60.0)
    stage = Source(drive.mechanism, motion).stage(Look(size=size, paths="tail"))
    exported = compiled(generate(drive.mechanism, Scene(level="picture"), drive.mechanism.guess))
    with ExitStack() as stack:
        # each renderer makes its own context the current one before it draws
        ways = [bare(stack, exported, size, drawing_on), bare(stack, stage.model, size, drawing_on)]
        pictures = draw(stage, drawing_on)
        stack.callback(pictures.close)
        ways.append(lambda: next(pictures))
        for direction in ways:
            direction()
        times = np.array([[measured(direction) for direction in ways] for _ in range(ROUNDS)])
    wall, cpu = 1e3 * np.median(times, axis=0).T
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        angles = motion.angle[:-1]
        render.write_video(
            Path(folder) / "a.mp4", drive.mechanism, motion, angles=angles, size=size, paths="tail"
        )
        whole = time.perf_counter() - start
    return wall, cpu, whole


def main():
    sizes = [word for word in sys.argv[1:] if word[0].isdigit()]
    width, height = map(int, (sizes or ["1280x720"])[0].split("x"))
    names = [word for word in sys.argv[1:] if not word[0].isdigit()] or list(catalog.DRIVES)
    drawing_on = gl_backend.choose()
    print(f"{drawing_on}, {width}x{height}; ms of wall (processor) a frame")
    print(f"{'':14}{'exported':>14}{'stage':>14}{'ours':>14}{'ratio':>8}{'240 frames':>14}")
    for name in names:
        wall, cpu, whole = row(name, (width, height), drawing_on)
        cells = "".join(f"{a:8.1f} ({b:3.0f})" for a, b in zip(wall, cpu, strict=True))
        print(f"{name:14}{cells}{wall[2] / wall[0]:8.2f}{whole:12.1f} s", flush=True)


if __name__ == "__main__":
    main()
