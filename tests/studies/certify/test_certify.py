from dataclasses import replace

import mpmath
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.io import catalog, reference_data
from mechsim.io.readers import open_model, parametric_model
from mechsim.kinematics.loops.constraints import cuts_of
from mechsim.kinematics.loops.motion import driven_path
from mechsim.numerics.balls import Ball, ball
from mechsim.studies.certify.certificate import proven_segments
from mechsim.studies.certify.computed_motion import computed_motion
from mechsim.studies.certify.loop_equations import concentric, loop_equations
from mechsim.studies.certify.toml_intervals import radii_within

REGULAR = [
    "four_bar",
    "slider_crank",
    "rssr",
    "rrsrr",
    "looper",
    "five_bar",
    "cardan_joint",
    "planetary_gear",
]


@pytest.mark.long
@pytest.mark.parametrize("name", REGULAR)
def test_a_mechanism_without_singularity_is_certified_over_its_range(name):
    proof = ms.certify(name)
    assert proof.certified, proof.reason
    assert proof.proven == pytest.approx(1.0)
    assert proof.min_singular_value > 1e-3


def test_the_singular_value_bound_is_below_the_computed_minimum():
    path = driven_path(ms.load("four_bar").mechanism, ms.load("four_bar").motion_laws)
    path.extend(2 * np.pi)
    q = path.interpolated(np.linspace(0.0, 2 * np.pi, 721))
    linearised = path.first.linearise(q)
    computed = linearised.singular_values[:, -1].min()
    assert 0.3 * computed < ms.certify("four_bar").min_singular_value <= computed


# a gear pair, a screw nut on a slide, and a cam whose lift is a polynomial
PRESS = model_text("certify_press.toml")


def test_ball_arithmetic_equations_agree_with_the_solver(file):
    rng = np.random.default_rng(0)
    press = file(PRESS)
    assert ms.certify(press).certified
    names = ("looper", "delta_robot", "warp_knitter", "sarrus", "rack_steering", "double_cardan")
    for name in (*names, press, "oldham_coupling", "planetary_gear"):
        solver = ms.load(name)
        path = driven_path(solver.mechanism, solver.motion_laws)
        loops = path.loops
        equations = loop_equations(
            loops.tree.mechanism, tuple(offset / (2 * np.pi) for offset in loops.turn_offsets), {}
        )
        assert [cut.joint.name for cut in cuts_of(loops.tree)] == [cut.joint.name for cut in equations.cuts]
        q = loops.displaced(path.start.repeated(5), 0.3 * rng.standard_normal((loops.tree.count, 5)))
        residual, jacobian, _ = loops.linearise(q)
        values = q.values.T.copy()
        values[:, loops.tree.ball_indices] = 0.0
        turns = [ball(np.moveaxis(rotation, -1, 0)) for rotation in q.turns]
        ball_residual, ball_jacobian = equations.evaluate(ball(values[..., None]), turns)
        kept = equations.kept
        assert np.abs(ball_residual.mid[..., 0].T - residual[kept]).max() < 1e-14
        assert np.abs(np.moveaxis(ball_jacobian.mid, 0, -1) - jacobian[kept]).max() < 1e-14
        assert np.abs(np.delete(residual, kept, 0)).max(initial=0.0) < 1e-15


def test_jacobians_over_a_box_enclose_those_of_its_points():
    solver = ms.load("looper")
    path = driven_path(solver.mechanism, solver.motion_laws)
    equations = loop_equations(path.loops.tree.mechanism, path.loops.turn_offsets, {})
    rng = np.random.default_rng(1)
    values = path.start.values.T.copy()
    values[:, equations.tree.ball_indices] = 0.0
    radius = 0.05
    turns = [ball(np.moveaxis(rotation, -1, 0)) for rotation in path.start.turns]
    box = equations.evaluate(Ball(values[..., None], np.full((*values.shape, 1), radius)), turns)
    for _ in range(50):
        inside = values + radius * rng.uniform(-1.0, 1.0, values.shape)
        point = equations.evaluate(ball(inside[..., None]), turns)
        for wide, thin in zip(box, point, strict=True):
            assert (np.abs(wide.mid - thin.mid) <= wide.rad + thin.rad).all()


def test_change_points_and_dead_centres_are_enclosed():
    def enclosed(kind, exact, name, **options):
        proof = ms.certify(name, **options)
        points = [point for point in proof.singular if point.kind == kind]
        assert not proof.certified
        assert len(points) == len(proof.singular) == len(exact)
        for point, angle in zip(points, sorted(exact), strict=True):
            assert abs(point.parameter - angle) <= point.width + 4e-15
            assert point.width < 1e-9

    # with one slide the assemblies meet where the crank is perpendicular to it; the other slide avoids that
    one_slide = str(reference_data.folder() / "mechanisms/elliptic_trammel.toml")
    enclosed("change point", [np.pi / 2], one_slide, angles="80:100deg")
    assert ms.certify(one_slide, "0:80deg").certified
    # ground and crank span coupler plus rocker, in a triangle of known sides
    four_bar = ms.catalog.make("four_bar", crank=0.09)
    ground, crank = four_bar.ground, four_bar.crank
    reach = four_bar.coupler + four_bar.rocker
    inner = abs(four_bar.coupler - four_bar.rocker)
    angles = [np.arccos((ground**2 + crank**2 - side**2) / (2 * ground * crank)) for side in (reach, inner)]
    enclosed("dead centre", [-angle for angle in angles], "four_bar", set={"crank": "90mm"})


def test_a_spherical_linkage_needs_concentric_axes_to_be_certified():
    assert ms.certify("spherical_four_bar").certified
    mechanism = ms.load("spherical_four_bar").mechanism
    assert all(joint.a.point == (0.0, 0.0, 0.0) for joint in concentric(mechanism).joints)
    first, *others = mechanism.joints
    off_axis = replace(first, a=replace(first.a, point=(1e-9, 0.0, first.a.point[2])))
    off_centre = replace(mechanism, joints=(off_axis, *others))
    assert concentric(off_centre) is off_centre


def test_a_rounding_sized_equation_is_no_identity():
    mechanism = ms.load("four_bar").mechanism
    joints = {joint.name: joint for joint in mechanism.joints}
    exact = loop_equations(mechanism, (), {})
    assert len(exact.kept) == len(exact.unknown) == 2
    tilted = replace(joints["A"], b=replace(joints["A"].b, axis=(1e-15, 0.0, 1.0), reference=None))
    others = [joint for name, joint in joints.items() if name != "A"]
    inexact = loop_equations(replace(mechanism, joints=(tilted, *others)), (), {})
    assert len(inexact.kept) > 2


def test_an_enclosure_excludes_the_other_assembly_mode():
    solver = ms.catalog.make("slider_crank")
    motion = computed_motion(solver, None, {})
    segments, rest, spent = proven_segments(motion)
    assert not spent
    assert not rest
    column = motion.equations.unknown.tolist().index(motion.equations.tree.index_of["A"])
    with mpmath.workdps(50):
        for angle in (0.1, 1.7, 4.0):
            i = int(np.searchsorted(segments.high, angle))
            s = mpmath.mpf(angle)
            height = mpmath.mpf(solver.offset) - mpmath.mpf(solver.crank) * mpmath.sin(s)
            centre = mpmath.mpf(segments.values[i, motion.equations.unknown[column]])
            centre += mpmath.mpf(segments.rate[i, column]) * (s - mpmath.mpf(segments.centre[i]))
            rod = mpmath.asin(height / mpmath.mpf(solver.rod))
            gaps = [abs(mpmath.sin((x - s - centre) / 2)) * 2 for x in (rod, mpmath.pi - rod)]
            assert gaps[0] <= segments.enclosure[i, column] < segments.width[i, column] < gaps[1]


NEARLY_SINGULAR = model_text("certify_nearly_singular.toml")


@pytest.mark.long
def test_a_turn_near_a_singularity_is_certified_and_one_through_it_is_not(tmp_path):
    # distances of the crank's end A from the rocker's circle, of radius r about R and with an axis n:
    # |A - R|^2 + r^2 -+ 2 r |A - R - n n.(A - R)|
    angles = np.linspace(0.0, 2.0 * np.pi, 100_001)[:, None]
    arm = 0.0235418287353761 * np.hstack([np.cos(angles), np.sin(angles), 0.0 * angles])
    arm -= [-0.07108248186474922, -0.034807908538435316, -0.004909487707574503]
    axis, radius = np.array([0.0, -0.8112745382057616, 0.5846653946139007]), 0.05979482061396265
    in_plane = arm - (arm @ axis)[:, None] * axis
    nearest = np.sqrt((arm**2).sum(1) + radius**2 - 2.0 * radius * np.linalg.norm(in_plane, axis=1)).max()
    for rod in (nearest + 1e-5, nearest - 1e-5):
        (tmp_path / "rssr.toml").write_text(NEARLY_SINGULAR.replace("0.052125217335690296", f"{rod}"))
        assert ms.certify(tmp_path / "rssr.toml").certified == (rod > nearest), rod


def test_a_table_of_a_motion_is_certified(tmp_path):
    time = np.linspace(0.0, 1.0, 30)
    rows = "\n".join(f"{t},{np.sin(3.0 * t)}" for t in time.tolist())
    (tmp_path / "law.csv").write_text(f"t,crank\n{rows}\n")
    assert ms.certify("four_bar", drive={"crank": str(tmp_path / "law.csv")}, duration=1.0).certified


def test_positions_in_an_mjcf_file_change_in_proportion():
    path = str(catalog.models() / "four_bar.xml")
    radii = radii_within(open_model(path), {}, parametric_model(path), {"B.a.at.x": 1e-4})
    assert {key: values.max() for key, values in radii.items()} == {"B.a": pytest.approx(1e-4, rel=1e-9)}
    with pytest.raises(ms.InputError, match=r"B\.a\.tilt\.x does not move joints in proportion"):
        radii_within(open_model(path), {}, parametric_model(path), {"B.a.tilt.x": 0.1})


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("rssr", {"crank": 1e-4, "gamma1": 1e-3, "pivot.x": 1e-4}),
        pytest.param("jansen", {"d": 1e-4, "b": 1e-4, "h": 1e-4}, marks=pytest.mark.long),
        pytest.param("delta_robot", {"base": 1e-3, "plate": 1e-3}, marks=pytest.mark.long),
        pytest.param("cardan_joint", {"bend": 0.02, "arm": 1e-3}, marks=pytest.mark.long),
    ],
)
def test_joint_intervals_are_tight_enclosures_of_joints_within_tolerances(name, bounds):
    model, designs = open_model(name), parametric_model(name)
    radii = radii_within(model, {}, designs, bounds)
    nominal = {joint.name: joint for joint in designs.describe({}).joints}
    rng, largest = np.random.default_rng(0), dict.fromkeys(radii, 0.0)
    for _ in range(40):
        moved = {
            key: designs.dimensions[key].value + limit * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)])
            for key, limit in bounds.items()
        }
        for joint in designs.describe(moved).joints:
            for side in ("a", "b"):
                end, start = getattr(joint, side), getattr(nominal[joint.name], side)
                now, before = ([x.point, x.axis, x.reference] for x in (end, start))
                error, key = np.abs(np.subtract(now, before)), f"{joint.name}.{side}"
                assert (error <= radii.get(key, np.zeros((3, 3))) + 1e-15).all()
                largest[key] = max(largest.get(key, 0.0), error.max())
    assert radii
    assert all(radii[key].max() < 3.0 * largest[key] for key in radii)
    if name == "jansen":
        assert not any(values[:, 2].any() for values in radii.values())


def test_a_spent_work_budget_is_named(monkeypatch):
    """A rhombus is singular at its change points: intervals about them are divided until the limit."""
    limit = 30
    monkeypatch.setattr("mechsim.studies.certify.certificate.MAX_SEGMENTS", limit)
    proof = ms.certify("four_bar", set={"crank": 0.1, "coupler": 0.1, "rocker": 0.1, "ground": 0.1})
    assert not proof.certified
    assert f"the work budget of {limit} segments is spent" in proof.summary
    assert "work budget" not in ms.certify("slider_crank", (0.1, 0.2)).summary
