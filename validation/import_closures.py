"""The code that each command can reach: lines of code in the import closure of its module.

    python validation/import_closures.py [COMMAND ...] [--modules]

The closure follows every import, also those inside functions, but not those under TYPE_CHECKING. An import
that an option or a kind of model asks for is a gate (`GATES`); the closure does not pass it. Code that only
one command reaches may be changed without the others. With --modules, the modules of the closure are listed.
"""

import argparse

import networkx as nx
import structure

# (module, imported module) -> what asks for the import
GATES = {
    ("numerics.loop_solver", "numerics.banded"): "a hundred unknowns",
    ("kinematics.loops.constraints", "numerics.banded"): "a hundred unknowns",
    ("kinematics.loops.constraints", "numerics.damped_band"): "a hundred unknowns",
    ("kinematics.loops.start", "numerics.damped_band"): "a hundred unknowns",
    ("kinematics.loops.start", "kinematics.loops.sparse_loops"): "many unknowns",
    ("simulation.model_loops", "numerics.banded"): "many unknowns",
    ("io.toml_reader", "io.toml_forces"): "forces in TOML",
    ("studies.validate", "studies.scene.own_settings"): "a MODEL in MJCF",
    ("io.scene_findings", "simulation.findings"): "a MODEL in MJCF",
    ("numerics.continuation", "numerics.branch_points"): "a change point",
    ("numerics.continuation", "numerics.fold_points"): "a crank that swings",
    ("simulation.stepping", "simulation.velocity_products"): "a driven cam",
    ("simulation.source", "simulation.mjcf_reader.reading"): "a MODEL in MJCF",
    ("io.mjcf_source", "io.requested_start"): "--start",
    ("io.prescription", "io.requested_start"): "--start",
    ("io.prescription", "kinematics.loops.joint_locks"): "--lock others",
    ("io.mjcf_source", "kinematics.loops.joint_locks"): "--lock",
    ("io.prescription", "io.law_text"): "--drive",
    ("io.prescription", "io.pose_drivers"): "--drive",
    ("io.prescription", "kinematics.loops.rounded_geometry"): "a mechanism without formulas",
    ("io.readers", "io.pose_drivers"): "drivers with motion laws",
    ("io.toml_coordinates", "io.law_text"): "motion laws in TOML",
    ("cli.simulate", "cli.scene_run"): "--ctrl",
    ("cli.validate", "cli.earlier"): "--compare-to",
    ("cli.validate", "report.dossier"): "--dossier",
    ("cli.validate", "report.validation"): "--report",
    ("cli.validate", "studies.reference"): "--reference",
    ("cli.validate", "io.reference_data"): "--reference",
    ("cli.export", "pictures.cam_files"): "--cam",
    ("studies.agreement.agreement", "studies.agreement.attribution"): "--against",
    ("studies.agreement.agreement", "studies.agreement.diagnosis"): "a comparison that fails",
    ("studies.agreement.agreement", "studies.agreement.misfit"): "a comparison that fails",
    ("studies.agreement.agreement", "studies.agreement.candidate_table"): "--against FILE.csv",
    ("studies.agreement.evaluation_points", "kinematics.derivatives.motion"): "a comparison that fails",
    ("studies.agreement.evaluation_points", "kinetics.model"): "a formula with a torque",
    ("studies.agreement.evaluation_points", "kinetics.prescribed_motion"): "a formula with a torque",
    ("studies.export", "pictures.render.scenery"): "--scene picture",
    ("studies.export", "pictures.flat_plates"): "--format dxf, svg",
    ("studies.export", "studies.robots.menagerie"): "--style menagerie",
    ("studies.export", "studies.robots.serial_twin"): "--format urdf, mjcf-tree",
    ("studies.export", "studies.scene.tune_model"): "--tolerance, --speed",
    ("studies.robots.mujoco_models", "simulation.source"): "a MODEL that is no file of MuJoCo",
    ("studies.robots.mujoco_models", "io.readers"): "a MODEL that is no file of MuJoCo",
    ("studies.check", "io.readers"): "a MODEL that is no file of MuJoCo",
    ("studies.check", "studies.robots.mujoco_models"): "a MODEL that is no file of MuJoCo",
    ("simulation.mjcf_reader.reading", "simulation.mjcf.equalities"): "--lock of the spin of a ball",
    ("simulation.mjcf_reader.parsed_file", "simulation.mjcf_reader.urdf_loops"): "a MODEL in URDF",
    ("shapes.joints", "shapes.belts"): "a belt or rope",
    ("io.toml_reader", "mechanism.belts"): "belts in TOML",
    ("io.toml_reader", "io.toml_curves"): "curves or cams in TOML",
    ("cli.solve", "io.driver_positions"): "--poses",
    ("mechanism.motion_laws", "numerics.balls"): "motion laws",
    ("numerics.collocation", "numerics.balls"): "a table of a motion law, enclosed",
    ("io.toml_reader", "mechanism.forces"): "forces in TOML",
    ("simulation.mjcf.generator", "simulation.mjcf.force_elements"): "a scene with forces",
    ("studies.export", "simulation.mjcf.force_elements"): "Coulomb friction",
    ("io.toml_coordinates", "mechanism.nonlinear_springs"): "soft stops in TOML",
    ("io.toml_values", "mechanism.coupling_functions"): "functions in TOML",
    ("mechanism.forces", "mechanism.nonlinear_springs"): "soft stops",
    ("simulation.mjcf_reader.forces", "mechanism.nonlinear_springs"): "polynomials of springs, ropes",
    ("cli", "simulation.mujoco_loading"): "a command that runs MuJoCo",
    ("io.toml_reader", "io.toml_backlash"): "backlash of joints in TOML",
    ("io.toml_reader", "io.toml_stated"): "sources of parameters in TOML",
}
# commands of the core, and those that only read MuJoCo models
COMMANDS = ("list", "show", "solve", "simulate", "validate", "export", "check", "sample", "map")


def loaded(gates: bool = True) -> nx.DiGraph:
    """Return which module loads which: imports without those for types, and without gates."""
    imported: dict[str, set[str]] = {}
    for name, path in structure.modules().items():
        inside = name if path.name == "__init__.py" else name.rpartition(".")[0]
        imported[name] = structure.imports_of(path.read_text(encoding="utf-8"), inside, typing=False)
    graph = structure.import_graph(imported)
    # a module of a package also loads the package
    graph.add_edges_from((name, name.rpartition(".")[0]) for name in imported if name.count(".") > 1)
    if gates:
        graph.remove_edges_from((f"mechsim.{a}", f"mechsim.{b}") for a, b in GATES)
    return graph


def closure(graph: nx.DiGraph, command: str) -> set[str]:
    """Return the modules that a command can reach."""
    module = "mechsim.cli." + {"list": "show"}.get(command, command)
    return {module, *nx.descendants(graph, module)}


def lines() -> dict[str, int]:
    """Return the lines of code of each module."""
    return {name: structure.code_lines(path.read_text("utf-8")) for name, path in structure.modules().items()}


def closures(commands: tuple[str, ...] = COMMANDS, gates: bool = True) -> dict[str, int]:
    """Return the lines of code that commands can reach."""
    graph, sizes = loaded(gates), lines()
    return {command: sum(sizes[name] for name in closure(graph, command)) for command in commands}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("commands", nargs="*", default=COMMANDS)
    parser.add_argument("--modules", action="store_true", help="list the modules")
    chosen = parser.parse_args()
    behind, ahead = closures(chosen.commands, gates=False), closures(chosen.commands)
    print(f"{'command':12} {'lines':>7} {'with all gates open':>20}")
    print(*(f"{name:12} {ahead[name]:7} {behind[name]:20}" for name in chosen.commands), sep="\n")
    if chosen.modules:
        graph, sizes = loaded(), lines()
        for command in chosen.commands:
            names = sorted(closure(graph, command), key=lambda name: -sizes[name])
            print(f"\n{command}", *(f"{sizes[name]:6} {name}" for name in names), sep="\n")


if __name__ == "__main__":
    main()
