"""Points on curves in TOML files, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.analytic.dynamics import dynamic_model, prescribed
from mechsim.errors import InputError

# a slider block on the ellipse (0.3 + 0.05 cos s, 0.2 sin s), whose rod is driven by a crank or by s
MODEL = """name = "rail"
drivers = ["rail"]
start = {{ rail = 0.5 }}
motion_laws.rail = "0.5 + 0.3*sin(2*pi*t)"
[links.crank]
inertia = {{ mass = 0.2, centre = [0.05, 0, 0], moments = [1e-4, 1e-4, 1e-4] }}
[links.rod]
inertia = {{ mass = 0.3, centre = [0.15, 0, 0], moments = [1e-5, 1e-3, 1e-3] }}
[curves.ellipse]
x = "0.3 + 0.05*cos(s)"
y = "0.2*sin(s)"
[joints.crank]
kind = "revolute"
a.link = "ground"
b.link = "crank"
[joints.pin]
kind = "revolute"
a = {{ link = "crank", at = [0.1, 0, 0] }}
b.link = "rod"
[joints.rail]
kind = "curve"
a = {{ link = "ground", curve = "{curve}" }}
b = {{ link = "rod", at = [0.3, 0, 0] }}
[points]
P = {{ link = "rod", at = [0.3, 0, 0] }}
"""


def load(folder, curve="ellipse"):
    path = folder / "rail.toml"
    path.write_text(MODEL.format(curve=curve))
    return ms.load(str(path))


@pytest.mark.long
def test_a_point_follows_its_curve_with_a_force_normal_to_it(tmp_path):
    model, times = load(tmp_path), np.linspace(0.0, 1.0, 41)
    point = model.solve(t=times).points["P"]
    w, s = 2 * np.pi, 0.5 + 0.3 * np.sin(2 * np.pi * times)
    v, a = 0.3 * w * np.cos(w * times), -0.3 * w**2 * np.sin(w * times)
    zero = np.zeros(41)
    first, second = (
        np.stack([-0.05 * np.sin(s), 0.2 * np.cos(s), zero], 1),
        np.stack([-0.05 * np.cos(s), -0.2 * np.sin(s), zero], 1),
    )
    exact = np.stack([0.3 + 0.05 * np.cos(s), 0.2 * np.sin(s), zero], 1)
    assert np.abs(point.position - exact).max() < 1e-14
    assert np.abs(point.velocity - first * v[:, None]).max() < 1e-12
    assert np.abs(point.acceleration - first * a[:, None] - second * v[:, None] ** 2).max() < 1e-11
    result = prescribed(dynamic_model(model), t=times)
    force = result.forces.reactions["rail.point"].force
    # the drive of s does the work of the tangential force
    driving = result.forces.drives["rail"]
    assert np.abs((force * first).sum(1) - driving).max() < 1e-10 * np.abs(driving).max()
    assert ms.validate(model).passed


def test_an_unknown_curve_is_rejected(tmp_path):
    with pytest.raises(InputError, match=r"joint 'rail' is of kind curve; .*a curve of the file \(ellipse\)"):
        load(tmp_path, "circle")


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('kind = "curve"', 'kind = "curve"\nroller = "6 mm"', "roller"),
        ('kind = "curve"', 'kind = "curve"\nlead = 1', "joint 'rail' is of kind curve"),
        ('y = "', 'closed = true\ny = "', "closed"),
        ("[curves.ellipse]", '[curves.other]\nx = "s"\n[curves.ellipse]', "the curve other"),
    ],
)
def test_what_is_not_used_is_rejected(tmp_path, old, new, named):
    path = tmp_path / "rail.toml"
    assert old in MODEL
    path.write_text(MODEL.format(curve="ellipse").replace(old, new))
    with pytest.raises(InputError, match=named):
        ms.load(str(path))


BEAD = """name = "bead"
[links.bead]
inertia = { mass = 0.5, centre = [0, 0, 0], moments = [1e-4, 1e-4, 1e-4] }
[curves.wire]
x = "0.2*cos(s)"
y = "0.1*sin(s)"
z = "0.02*sin(2*s)"
[joints.rail]
kind = "curve"
a = { link = "ground", curve = "wire" }
b = { link = "bead" }
"""


def test_a_bead_slides_along_a_spatial_wire_as_an_independent_integration(tmp_path):
    (tmp_path / "bead.toml").write_text(BEAD)
    model = ms.load(str(tmp_path / "bead.toml"), still=True)
    run = ms.dynamics.run(model, initial={"rail.q": 0.3}, duration=1.0, samples=10)

    def falling(_, state):
        # c'.c' s'' = c'.(g - c'' s'^2)
        s, v = state
        first = np.array([-0.2 * np.sin(s), 0.1 * np.cos(s), 0.04 * np.cos(2 * s)])
        second = np.array([-0.2 * np.cos(s), -0.1 * np.sin(s), -0.08 * np.sin(2 * s)])
        return v, first @ (np.array([0.0, -9.81, 0.0]) - second * v**2) / (first @ first)

    exact = solve_ivp(falling, (0, 1), [0.3, 0.0], method="DOP853", rtol=1e-13, atol=1e-13, t_eval=run.time)
    assert np.abs(run.motion.joints["rail"].value - exact.y[0]).max() < 1e-11
    assert run.energy_error < 1e-11
