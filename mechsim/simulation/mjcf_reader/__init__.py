"""Reads MJCF files into mechanisms: positions, axes, anchors and couplings copied as data, nothing solved."""

from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput, model_label
from mechsim.simulation.mjcf_reader.reading import MjcfModel, read_model, states_of

__all__ = ["MjcfModel", "MujocoInput", "model_label", "read_model", "states_of"]
