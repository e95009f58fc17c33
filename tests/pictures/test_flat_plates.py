"""Links as drawings: the distances of holes are the dimensions, in DXF and in SVG."""

from itertools import combinations, pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

SVG = "{http://www.w3.org/2000/svg}"


def entities(text):
    """Return the entities of a DXF file as lists of (group code, value), with vertices in their polyline."""
    lines = text.splitlines()
    groups = [(int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=True)]
    starts = [i for i, (code, _) in enumerate(groups) if code == 0] + [len(groups)]
    return [groups[i:j] for i, j in pairwise(starts)]


def numbers(entity, *codes):
    values = dict(entity)
    return [float(values.get(code, 0.0)) for code in codes]


def holes_in_dxf(text):
    """Return layer -> centres of circles and their diameter, (k, 3) in mm."""
    result = {}
    for entity in entities(text):
        if entity[0][1] == "CIRCLE":
            x, y, radius = numbers(entity, 10, 20, 40)
            result.setdefault(dict(entity)[8], []).append((x, y, 2.0 * radius))
    return {layer: np.array(rows) for layer, rows in result.items()}


def holes_in_svg(text):
    """Return title -> as `holes_in_dxf`."""
    result = {}
    for group in ElementTree.fromstring(text)[0]:
        circles = [
            [float(circle.get(key)) for key in ("cx", "cy", "r")] for circle in group.iter(f"{SVG}circle")
        ]
        result[group.findtext(f"{SVG}title")] = np.reshape(circles, (-1, 3)) * [1.0, 1.0, 2.0]
    return result


def distances(holes):
    return sorted(float(np.hypot(*(a - b)[:2])) for a, b in combinations(holes, 2))


@pytest.mark.parametrize(("format", "read"), [("dxf", holes_in_dxf), ("svg", holes_in_svg)])
def test_the_distances_of_holes_are_the_dimensions_in_millimetres(format, read):
    lengths = {"crank": 0.041, "coupler": 0.123456789, "rocker": 0.08, "ground": 0.1}
    holes = read(ms.export("four_bar", set=lengths, format=format, hole="6mm").text)
    assert holes.keys() == lengths.keys()
    for link, length in lengths.items():
        assert distances(holes[link]) == pytest.approx([1e3 * length], abs=1e-6)
        assert (holes[link][:, 2] == 6.0).all()


def test_a_link_with_three_holes_has_the_distances_of_its_points():
    mechanism = ms.load("klann").mechanism
    holes = holes_in_dxf(ms.export("klann", format="dxf").text)
    for link in ("rod", "ground"):
        points = {end.point for joint in mechanism.joints for end in (joint.a, joint.b) if end.link == link}
        expected = sorted(1e3 * float(np.linalg.norm(np.subtract(a, b))) for a, b in combinations(points, 2))
        assert distances(holes[link]) == pytest.approx(expected, abs=1e-6)


def arcs_and_edges(entity_list):
    """Yield layer and points along the closed polylines of a DXF file, arcs by their bulges."""
    for i, entity in enumerate(entity_list):
        if entity[0][1] == "POLYLINE":
            vertices = []
            for vertex in entity_list[i + 1 :]:
                if vertex[0][1] != "VERTEX":
                    break
                vertices.append(numbers(vertex, 10, 20, 42))
            points = []
            for (x, y, bulge), (u, v, _) in zip(vertices, vertices[1:] + vertices[:1], strict=True):
                start, end = complex(x, y), complex(u, v)
                angle, chord = 4.0 * np.arctan(bulge), end - start
                for t in np.linspace(0.0, 1.0, 9):
                    # a chord from the start to a point of the arc turns by half of the angle that is left
                    along = np.sin(t * angle / 2.0) / np.sin(angle / 2.0) if bulge else t
                    points.append(start + chord * along * np.exp(-0.5j * (1.0 - t) * angle))
            yield dict(entity)[8], np.array(points)


def test_an_outline_keeps_its_distance_from_every_hole():
    text = ms.export("jansen", format="dxf", hole=0.004).text
    holes = holes_in_dxf(text)
    for layer, outline in arcs_and_edges(entities(text)):
        gaps = np.abs(outline[:, None] - (holes[layer][:, 0] + 1j * holes[layer][:, 1]))
        assert gaps.min() == pytest.approx(6.0, abs=1e-6)
        assert (gaps.min(1) > 6.0 - 1e-6).all()


def test_a_cam_has_its_profile_around_the_hole_of_its_axle(tmp_path):
    (tmp_path / "cam.toml").write_text(model_text("cam_export_cam.toml"))
    text = ms.export(tmp_path / "cam.toml", format="dxf").text
    ((x, y, _),) = holes_in_dxf(text)["cam"]
    (outline,) = (points for layer, points in arcs_and_edges(entities(text)) if layer == "cam")
    q = np.linspace(0.0, 2.0 * np.pi, 1440, endpoint=False)
    s, rate = 0.005 * (1 - np.cos(q)), 0.005 * np.sin(q)
    radii = 1e3 * np.hypot(0.025 + s, rate)
    np.testing.assert_allclose(np.abs(outline[::9] - complex(x, y)), radii, atol=1e-6)


def test_links_that_are_not_flat_are_named():
    drawn = ms.export("rssr", format="dxf")
    assert {*holes_in_dxf(drawn.text)} == {"crank", "coupler", "rocker"}
    assert drawn.left_out.endswith(": ground")


def test_names_that_dxf_does_not_have_become_distinct_layers(tmp_path):
    text = model_text("cam_export_cam.toml").replace('"follower"', '"a§b"')
    text = text.replace('link = "cam"', 'link = "a b"')
    (tmp_path / "cam.toml").write_text(text, encoding="utf-8")
    drawn = ms.export(tmp_path / "cam.toml", format="dxf").text
    assert drawn.isascii()
    layers = {dict(entity)[8] for entity in entities(drawn) if entity[0][1] == "POLYLINE"}
    assert layers == {"ground", "a_b", "a_b_"}
